"""A worker of a call: a process of its own, and its end of the connection to the page's process."""

import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from threading import Event, Lock
from typing import Any

from protocol.link.link_protection import STRANGERS
from risorius.live_call.messages import FromWorker, Strangers, Trouble
from runtime.fork_server import name_process
from runtime.object_stream import ObjectStream
from shared_model.errors import UserError

# How often a worker tells how it goes.
FIGURES_S = 1.0


class WorkerConnection:
    """The connection of a worker to the process of the page.

    pipe: descriptor of a pipe that the worker has been given; None: none.
    is_over: set once that is gone, or wants the worker to end.
    """

    def __init__(self, stream: ObjectStream, pipe: int | None = None) -> None:
        self._stream, self._lock, self.is_over = stream, Lock(), Event()
        self.pipe = pipe

    def send(self, message: FromWorker) -> None:
        """Send a message; any thread may.  Without anybody to receive it, it is lost."""
        with self._lock, suppress(OSError):
            self._stream.send(message)

    def tell_of_link(self, line: str) -> None:
        """Send on what a link says of strangers; how it goes else is told every second."""
        if line == STRANGERS:
            self.send(Strangers())

    def obey(self, do: Callable[[Any], None]) -> None:
        """Call `do` with what comes, until the other end is gone; then the worker is over.

        A mistake of the user in it is sent back.  Any other error ends the worker.
        """
        try:
            for message in self._messages():
                try:
                    do(message)
                except UserError as error:
                    self.send(Trouble(str(error)))
        finally:
            self.is_over.set()

    def in_background(self, work: Callable[[], None]) -> None:
        """Run something in a thread that does not keep the process alive."""
        threading.Thread(target=work, daemon=True).start()

    def every_second(self, tell: Callable[[], FromWorker]) -> None:
        """Send what `tell` returns once a second."""

        def work() -> None:
            while not self.is_over.wait(FIGURES_S):
                self.send(tell())

        self.in_background(work)

    def _messages(self) -> Iterator[Any]:
        while True:
            try:
                yield self._stream.receive()
            except EOFError:
                return


def serve(descriptor: int, module: str, pipe: int | None = None) -> None:
    """Run a worker, `module`.run: its options come first over the socket.

    pipe: see `WorkerConnection`.

    A mistake of the user ends it with a message.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    name_process(module)
    run: Callable[[WorkerConnection, Any], None] = import_module(module).run
    stream = ObjectStream(socket.socket(fileno=descriptor))
    worker = WorkerConnection(stream, pipe)
    try:
        options = stream.receive()
    except EOFError:
        # The call has ended before it began.
        return
    try:
        run(worker, options)
    except UserError as error:
        worker.send(Trouble(str(error), error.exit_code))
    stream.close()
