"""A process of this program beside the one that starts it, and a socket between them."""

import os
import socket
import subprocess
import sys
from collections.abc import Sequence


def start_child(
    module: str, arguments: Sequence[str] = (), descriptors: Sequence[int] = ()
) -> tuple["subprocess.Popen[bytes]", socket.socket]:
    """Start a process that calls `serve` of a module; returns it and this end of the socket.

    serve: gets the descriptor of its end of the socket, then the arguments.
    descriptors: of this process, that it gets as well.
    """
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
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                # Ctrl-C in a terminal is for the process that talks to the user.
                start_new_session=True,
            )
    except BaseException:
        ours.close()
        raise
    return process, ours
