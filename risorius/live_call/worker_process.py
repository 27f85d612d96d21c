"""A worker of a call as the page's process sees it: started, spoken to, and ended."""

import asyncio
import subprocess
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Thread

from risorius.live_call.messages import (
    CameraPicture,
    DrawingOptions,
    FromWorker,
    MicrophoneSound,
    SendingOptions,
    ToDrawer,
    ToSender,
)
from runtime.child_process import start_child
from runtime.object_stream import ObjectStream

# Pictures and pieces of sound that may wait for a worker that is busy.
MAX_PICTURES, MAX_SOUNDS = 2, 50
# How long a worker that has been told to end may take.
END_S = 5.0


class WorkerProcess:
    """A process that runs `module`.run until it is closed; its options come later.

    pipe: descriptor of a pipe that it gets; None: none.
    receive: called in `loop` with each of its messages, and with None when it has ended.
    """

    def __init__(
        self,
        module: str,
        pipe: int | None,
        receive: Callable[[FromWorker | None], None],
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        self._process, ours = start_child(
            "risorius.live_call.worker_connection", [module], [] if pipe is None else [pipe]
        )
        self._stream = ObjectStream(ours)
        self._receive_message, self._loop = receive, loop
        self._waiting = deque[SendingOptions | DrawingOptions | ToSender | ToDrawer]()
        self._changed, self._has_begun, self._is_closed = Condition(), False, False
        Thread(target=self._receive, daemon=True).start()
        Thread(target=self._send, daemon=True).start()

    def run(self, options: SendingOptions | DrawingOptions) -> None:
        """Let it begin; messages wait until then."""
        with self._changed:
            self._waiting.appendleft(options)
            self._has_begun = True
            self._changed.notify()

    def send(self, message: ToSender | ToDrawer) -> None:
        """Send a message; of pictures and sound the oldest go if too many wait."""
        with self._changed:
            for kind, limit in ((CameraPicture, MAX_PICTURES), (MicrophoneSound, MAX_SOUNDS)):
                if isinstance(message, kind):
                    same = [each for each in self._waiting if isinstance(each, kind)]
                    if len(same) >= limit:
                        self._waiting.remove(same[0])
            self._waiting.append(message)
            self._changed.notify()

    def close(self) -> None:
        """Let the process end; returns at once, see `wait`."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def wait(self) -> None:
        """Wait until the process has ended; it is killed if it takes too long, or has not begun."""
        if not self._has_begun:
            self._process.kill()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _send(self) -> None:
        with suppress(OSError):
            while True:
                with self._changed:
                    while not (self._has_begun and self._waiting) and not self._is_closed:
                        self._changed.wait()
                    if not (self._has_begun and self._waiting):
                        break
                    message = self._waiting.popleft()
                self._stream.send(message)
            # The process may still say something.
            self._stream.end()

    def _receive(self) -> None:
        with suppress(EOFError):
            while True:
                self._tell(self._stream.receive())
        self._stream.close()
        self._tell(None)

    def _tell(self, message: FromWorker | None) -> None:
        # The loop may be closed already.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._receive_message, message)
