"""A process of this program beside the one that starts it, and a socket between them."""

import atexit
import os
import socket
import subprocess
import sys
from collections.abc import Sequence

Child = tuple["subprocess.Popen[bytes]", socket.socket]
# Children that were started early and that nobody has asked for yet, by their modules.
_early: dict[str, Child] = {}


def start_early(module: str) -> None:
    """Start the process that a `start_child` without arguments will ask for.

    It loads its libraries while this process loads its own.  If nobody asks, it ends with this one.
    """
    if module not in _early:
        _early[module] = _started(module, (), ())
        atexit.register(_end_early, module)


def _end_early(module: str) -> None:
    if child := _early.pop(module, None):
        process, connection = child
        process.kill()
        process.wait()
        connection.close()


def start_child(
    module: str, arguments: Sequence[str] = (), descriptors: Sequence[int] = ()
) -> Child:
    """Start a process that calls `serve` of a module; returns it and this end of the socket.

    serve: gets the descriptor of its end of the socket, then the arguments.
    descriptors: of this process, that it gets as well.
    """
    early = None if arguments or descriptors else _early.pop(module, None)
    return early or _started(module, arguments, descriptors)


def _started(module: str, arguments: Sequence[str], descriptors: Sequence[int]) -> Child:
    ours, theirs = socket.socketpair()
    program = (
        f"import sys; sys.path[:] = {sys.path!r};"
        f" from shared_model.logs import follow_environment; follow_environment();"
        f" from {module} import serve;"
        f" serve({theirs.fileno()}, *{list(arguments)!r})"
    )
    try:
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-c", program],
                pass_fds=[theirs.fileno(), *descriptors],
                stdin=subprocess.DEVNULL,
                # Before NumPy is loaded: what it would spread over all cores is small.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1"},
                # Ctrl-C in a terminal is for the process that talks to the user.
                start_new_session=True,
            )
    except BaseException:
        ours.close()
        raise
    return process, ours
