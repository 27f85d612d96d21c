"""Calls to an object in a process of its own, whose results come later."""

import logging
import socket
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from itertools import count
from typing import Any

from runtime.child_process import start_child
from runtime.object_stream import ObjectStream
from shared_model.errors import UserError

_log = logging.getLogger(__name__)

Shared = Mapping[str, Callable[[], object]]


class RemoteCalls:
    """Calls the methods of an object in a child process, in order; it ends with this process.

    module: its `serve` answers them, see `answer_calls`.
    shared: see `ObjectStream`.
    on_failure: called once with the reason if the process ends by itself, cannot be understood, or
        fails with anything but a `UserError`; whoever asks for results goes on without them.
    """

    def __init__(
        self, module: str, on_failure: Callable[[str], None], shared: Shared | None = None
    ) -> None:
        self._process, ours = start_child(module)
        self._name = module.rpartition(".")[2].replace("_", " ")
        self._stream, self._on_failure = ObjectStream(ours, shared), on_failure
        self._numbers, self._waiting = count(), dict[int, Future[Any]]()
        self._is_closing = self._has_ended = False
        # Reason why this process has ended the other one.
        self._why_ended: str | None = None
        # Results that somebody waits for: they fail when the process ends.
        self._ending, self._awaited = threading.Lock(), list[Future[Any]]()
        # Objects are put together and sent in a thread of their own.
        self._sender = ThreadPoolExecutor(1)
        threading.Thread(target=self._receive, daemon=True).start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def call(self, method: str, *arguments: object) -> "Future[Any]":
        """Call a method; if the process fails first, the result is never done."""
        future = Future[Any]()
        if self._has_ended:
            return future
        number = next(self._numbers)
        self._waiting[number] = future
        self._sender.submit(self._send, number, method, arguments)
        return future

    def call_awaited(self, method: str, *arguments: object) -> "Future[Any]":
        """Call a method; if the process fails first, the result is a `ChildProcessError`."""
        with self._ending:
            future = self.call(method, *arguments)
            if self._has_ended:
                future.set_exception(ChildProcessError())
            else:
                self._awaited = [each for each in self._awaited if not each.done()] + [future]
        return future

    def close(self) -> None:
        """End the process; closing twice has no further effect."""
        self._is_closing = True
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            # What is being sent to a process that never was there ends.
            self._stream.end()
        self._sender.shutdown(cancel_futures=True)
        self._stream.close()

    def _send(self, number: int, method: str, arguments: tuple[object, ...]) -> None:
        try:
            self._stream.send((number, method, arguments))
        except OSError:
            # A process that is gone is noticed where its results are received.
            return
        except Exception as error:
            # An argument that cannot be pickled.  Told where results are received: only that thread
            # settles results.
            self._why_ended = f"the {self._name} cannot be asked ({error!r})"
            self._process.kill()

    def _receive(self) -> None:
        try:
            while True:
                number, result, error = self._stream.receive()
                future = self._waiting.pop(number)
                if error is None:
                    future.set_result(result)
                elif isinstance(error, UserError):
                    future.set_exception(error)
                else:
                    self._fail(f"the {self._name} has failed ({error})")
                    return
        except EOFError:
            code = self._process.wait()
            how = "" if code is None else f" ({code})"
            self._fail(self._why_ended or f"the {self._name} has ended{how}")
        except Exception as error:
            # Whatever unpickling raises.
            self._fail(f"what the {self._name} has sent cannot be read ({error!r})")

    def _fail(self, reason: str) -> None:
        with self._ending:
            if self._has_ended or self._is_closing:
                return
            self._has_ended = True
            for future in self._awaited:
                if not future.done():
                    future.set_exception(ChildProcessError())
        self._process.kill()
        self._on_failure(reason)


def answer_calls(descriptor: int, target: object, shared: Shared | None = None) -> None:
    """Call the methods of an object as another process asks at the other end of a socket.

    descriptor: of the socket.  Methods that return a `Future` are answered when it is done; the
    next one is called at once.  A result that cannot be pickled counts as a failure.  Returns when
    the other process is gone.
    """
    stream, lock = ObjectStream(socket.socket(fileno=descriptor), shared), threading.Lock()

    def reply(number: int, result: object, error: BaseException | None) -> None:
        # If the other process is gone, nobody waits for this.
        with lock, suppress(OSError):
            try:
                stream.send((number, result, error))
            except OSError:
                raise
            except Exception as unsendable:
                # A result that cannot be pickled: whoever waits for it must hear of it.
                stream.send((number, None, ChildProcessError(repr(unsendable))))

    def answer(number: int, method: str, done: "Future[Any]") -> None:
        error = done.exception()
        if error is not None and not isinstance(error, UserError):
            _log.info("%s has failed", method, exc_info=error)
            # Not every error can be sent.
            error = ChildProcessError(repr(error))
        reply(number, None if error else done.result(), error)

    with suppress(EOFError):
        while True:
            number, method, arguments = stream.receive()
            result = getattr(target, method)(*arguments)
            if isinstance(result, Future):
                result.add_done_callback(partial(answer, number, method))
            else:
                reply(number, None, None)
