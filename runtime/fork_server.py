"""A process that has loaded libraries and compiled loops, and becomes others by fork (Linux).

The processes of one program need the same libraries: each that starts afresh takes as long for them
as the first.  A fork has at once what the server has loaded, and shares its memory.  The server has
no threads of its own.

Client and server speak over a socket that keeps messages apart.  Requests are JSON arrays, done in
their order: `RUN`, module, function; or `FORK`, module, arguments, with a socket by which the
server tells of the child, and the descriptors of the child.
"""

import gc
import json
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from select import select
from threading import Lock
from time import monotonic

RUN, FORK = "run", "fork"
MAX_BYTES, MAX_DESCRIPTORS = 1 << 16, 16
# What the system keeps of the name of a process.
NAME_LENGTH = 15


class ForkedChild:
    """A child of a fork server, as the process sees it that has asked for it.

    told: socket by which the server tells of it when it is there.
    """

    def __init__(self, told: socket.socket) -> None:
        self._told, self._pid = told, -1
        self._descriptor: int | None = None
        self._lock = Lock()  # of what the server tells, once

    @property
    def pid(self) -> int:
        """Its number; waits until it is there.  Raises `ChildProcessError` if it never will be."""
        if self._process() is None:
            raise ChildProcessError("the fork server has ended")
        return self._pid

    def kill(self) -> None:
        """End it; one that is not there yet never will be."""
        if not self._is_told(0):
            # The server ends it when it cannot tell of it.
            self._told.shutdown(socket.SHUT_RDWR)
        # It may have been told of just before.
        if (process := self._process()) is not None:
            _kill(process)

    def wait(self, timeout: float | None = None) -> None:
        """Wait until it has ended.  Raises `subprocess.TimeoutExpired` after so many seconds."""
        start_s = monotonic()
        if self._is_told(timeout):
            process = self._process()
            left_s = None if timeout is None else max(0.0, timeout - (monotonic() - start_s))
            if process is None or select([process], [], [], left_s)[0]:
                return
        raise subprocess.TimeoutExpired("a forked process", timeout or 0)

    def _is_told(self, timeout: float | None) -> bool:
        return self._pid >= 0 or bool(select([self._told], [], [], timeout)[0])

    def _process(self) -> int | None:
        """Its descriptor; waits until the server has told of it.  None: the server cannot."""
        with self._lock:
            if self._pid < 0:
                data, descriptors, *_ = socket.recv_fds(self._told, MAX_BYTES, 1)
                self._descriptor = descriptors[0] if descriptors else None
                self._pid = int(data or 0)
            return self._descriptor

    def __del__(self) -> None:
        self._told.close()
        if self._descriptor is not None:
            os.close(self._descriptor)


class ForkServer:
    """A fork server, as its clients see it; requests do not wait until they are done.

    requests: socket of the server.
    """

    def __init__(self, requests: socket.socket) -> None:
        self._requests = requests

    def run(self, module: str, function: str) -> None:
        """Let the server call a function, which loads what children will need."""
        self._request([RUN, module, function], [])

    def fork(
        self, module: str, arguments: Sequence[str], descriptors: Sequence[int]
    ) -> ForkedChild:
        """Let the server become a process that calls `serve` of a module.

        arguments, descriptors: see `start_child`.  A server that has ended forks no child.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            self._request([FORK, module, list(arguments)], [theirs.fileno(), *descriptors])
        return ForkedChild(ours)

    def _request(self, request: list[object], descriptors: Sequence[int]) -> None:
        with suppress(OSError):
            socket.send_fds(self._requests, [json.dumps(request).encode()], descriptors)


class _Server:
    """The server itself: becomes other processes until all its clients are gone."""

    def __init__(self, client: socket.socket) -> None:
        self._clients = [client]

    def serve(self) -> Callable[[], None] | None:
        """Do what clients ask; what to do in a process that this one has become, else None."""
        while self._clients:
            for client in select(self._clients, [], [])[0]:
                data, descriptors, *_ = socket.recv_fds(client, MAX_BYTES, MAX_DESCRIPTORS)
                if not data:
                    self._clients.remove(client)
                    client.close()
                    continue
                kind, module, details = json.loads(data)
                if kind == RUN:
                    getattr(import_module(module), details)()
                    # Memory that the collector never looks at stays shared.
                    gc.freeze()
                elif become := self._fork(module, details, descriptors):
                    return become
        return None

    def _fork(
        self, module: str, arguments: list[str], descriptors: list[int]
    ) -> Callable[[], None] | None:
        ours, theirs = request_sockets()
        told, *given = descriptors
        pid = os.fork()
        if pid == 0:
            for client in (*self._clients, ours):
                client.close()
            os.close(told)
            return partial(_become, theirs, module, [given[0], *arguments, *given[1:]])
        theirs.close()
        self._clients.append(ours)
        _tell_of(pid, socket.socket(fileno=told))
        for each in given:
            os.close(each)
        return None


def _tell_of(pid: int, told: socket.socket) -> None:
    """Tell whoever has asked for it of a child; without anybody there is none."""
    with told, suppress(ProcessLookupError):  # it has ended already
        descriptor = os.pidfd_open(pid)
        try:
            socket.send_fds(told, [str(pid).encode()], [descriptor])
        except OSError:
            _kill(descriptor)
        finally:
            os.close(descriptor)


def _kill(process: int) -> None:
    """End the process of a descriptor, if it has not ended."""
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(process, signal.SIGKILL)


def _become(requests: socket.socket, module: str, arguments: list[str | int]) -> None:
    """Be another process from here on, with a session of its own."""
    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    name_process(module)
    use_server(ForkServer(requests))
    import_module(module).serve(*arguments)


def serve(descriptor: int) -> None:
    """Serve the process at the other end of a socket, and the processes that this one becomes."""
    # Ctrl-C in a terminal is for who talks to the user, and nobody here waits for children.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    become = _Server(socket.socket(fileno=descriptor)).serve()
    if become is not None:
        become()


def can_fork() -> bool:
    """Whether this system has descriptors of processes, by which others than the parent wait."""
    try:
        os.close(os.pidfd_open(os.getpid()))
    except (AttributeError, OSError):
        return False
    return True


def request_sockets() -> tuple[socket.socket, socket.socket]:
    """The ends of a server and of one of its clients."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


# That which this process is a fork of, or has started; None: there is none.
_current: ForkServer | None = None


def current_server() -> ForkServer | None:
    """The fork server that makes the processes of this one; None: they start afresh."""
    return _current


def use_server(server: ForkServer | None) -> None:
    """Let a fork server make the processes of this one."""
    global _current
    _current = server


def name_process(module: str) -> None:
    """Name this process for a module, as the system lists it."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(module.rpartition(".")[2][:NAME_LENGTH], "ascii")
