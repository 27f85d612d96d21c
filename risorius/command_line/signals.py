"""Ctrl-C and the request to end, as a question that a pipeline asks between two frames."""

import signal
from collections.abc import Callable
from types import FrameType
from typing import Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Progress = Callable[[int, int | None], None]


class StopOnSignal:
    """True once the user has asked to stop; the second request interrupts at once.

    Within the `with` block a first SIGINT, SIGTERM or SIGHUP only sets the answer, so that the
    frame at hand and the files are finished.  Before the first frame there is nothing to finish and
    somebody to wait for, perhaps, and while a call is prepared nothing to keep: it interrupts, as
    the second does; and is the answer, too, in case that the exception gets lost in a finaliser.
    More are not heard: a link whose closing is interrupted leaves threads behind that never end.
    The handlers of before come back on leaving.
    """

    def __init__(self) -> None:
        self._started = self._preparing = self._stopped = self._interrupted = False

    def __call__(self) -> bool:
        return self._stopped

    def watch(self, progress: Progress) -> Progress:
        """`progress`, with a note that the first frame is through."""

        def noted(done: int, total: int | None) -> None:
            self._started = True
            progress(done, total)

        return noted

    def watch_preparing(self, preparing: Callable[[str], None]) -> Callable[[str], None]:
        """`preparing`, with a note that there is nothing to keep until it is called with ""."""

        def noted(what: str) -> None:
            self._preparing = bool(what)
            preparing(what)

        return noted

    def __enter__(self) -> Self:
        # Whoever was started by nohup goes on when the terminal is closed.
        ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        heard = SIGNALS if ignored else (*SIGNALS, signal.SIGHUP)
        self._before = {number: signal.signal(number, self._handle) for number in heard}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._interrupted:
            return
        if self._stopped or self._preparing or not self._started:
            self._stopped = self._interrupted = True
            raise KeyboardInterrupt
        self._stopped = True
