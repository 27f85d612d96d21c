"""Ctrl-C and other requests to end, as a question that a pipeline asks between two frames."""

import signal
from collections.abc import Callable
from types import FrameType
from typing import Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Progress = Callable[[int, int | None], None]


class StopOnSignal:
    """Called, it says whether the user has asked to stop; a second request interrupts at once.

    Within the `with` block SIGINT, SIGTERM and SIGHUP are handled like this:

    - before the first frame, and while a call is prepared: `KeyboardInterrupt`, since there is no
      output to finish;
    - afterwards, the first signal: the answer becomes True, and the pipeline finishes the current
      frame and its files;
    - the second signal: `KeyboardInterrupt`;
    - further signals have no effect: a link whose closing is interrupted leaves threads behind that
      never end.

    After a `KeyboardInterrupt` the answer is True as well, since an exception that is raised in a
    finaliser gets lost.  Leaving the block restores the handlers.
    """

    def __init__(self) -> None:
        self._started = self._preparing = self._stopped = self._interrupted = False

    def __call__(self) -> bool:
        return self._stopped

    def watch(self, progress: Progress) -> Progress:
        """`progress`, which also notes that the first frame is done."""

        def noted(done: int, total: int | None) -> None:
            self._started = True
            progress(done, total)

        return noted

    def watch_preparing(self, preparing: Callable[[str], None]) -> Callable[[str], None]:
        """`preparing`, which also notes that there is no output until it is called with ""."""

        def noted(what: str) -> None:
            self._preparing = bool(what)
            preparing(what)

        return noted

    def __enter__(self) -> Self:
        # A process started by nohup goes on when the terminal is closed.
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
