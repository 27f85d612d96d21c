"""A process of this program beside the one that starts it, and a socket between them."""

import atexit
import os
import socket
import subprocess
import sys
from collections.abc import Sequence

from runtime.fork_server import (
    ForkedChild,
    ForkServer,
    can_fork,
    current_server,
    request_sockets,
    use_server,
)

Process = subprocess.Popen[bytes] | ForkedChild
# Read as libraries are loaded.  What NumPy would spread over all cores is small; and arrays of some
# megabytes that are freed stay with the process: to get new pages takes longer than to fill them.
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 26),
}


def start_fork_server(module: str, function: str) -> None:
    """Let all children come from one process, which first calls a function of a module.

    That loads what they need, while this process goes on.  It ends with this one.  Where the system
    has none, children start afresh; where there is one already, it loads this as well.
    """
    if server := current_server():
        server.run(module, function)
        return
    if not can_fork():
        return
    theirs, ours = request_sockets()
    with theirs:
        process = _start("runtime.fork_server", theirs, (), ())
    server = ForkServer(ours)
    server.run(module, function)
    use_server(server)
    # Also while it still loads.
    atexit.register(_end, process)


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()


def start_child(
    module: str, arguments: Sequence[str] = (), descriptors: Sequence[int] = ()
) -> tuple[Process, socket.socket]:
    """Start a process that calls `serve` of a module; returns it and this end of the socket.

    serve: gets the descriptor of its end of the socket, then the arguments, then its descriptors.
    descriptors: of this process, that it gets as well.
    """
    ours, theirs = socket.socketpair()
    try:
        with theirs:
            server = current_server()
            if server is not None:
                return server.fork(module, arguments, [theirs.fileno(), *descriptors]), ours
            return _start(module, theirs, arguments, descriptors), ours
    except BaseException:
        ours.close()
        raise


def _start(
    module: str, theirs: socket.socket, arguments: Sequence[str], descriptors: Sequence[int]
) -> "subprocess.Popen[bytes]":
    given = [theirs.fileno(), *arguments, *descriptors]
    program = (
        f"import sys; sys.path[:] = {sys.path!r};"
        f" from shared_model.logs import follow_environment; follow_environment();"
        f" from {module} import serve;"
        f" serve(*{given!r})"
    )
    return subprocess.Popen(
        [sys.executable, "-c", program],
        pass_fds=[theirs.fileno(), *descriptors],
        stdin=subprocess.DEVNULL,
        env=os.environ | ENVIRONMENT,
        # Ctrl-C in a terminal is for the process that talks to the user.
        start_new_session=True,
    )
