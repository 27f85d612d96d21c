"""Ctrl-C and the request to end, as a question that a pipeline asks between two frames."""

import signal
from types import FrameType
from typing import Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopOnSignal:
    """True once the user has asked to stop; the second request interrupts at once.

    Within the `with` block a first SIGINT or SIGTERM only sets the answer, so that files are
    finished; a second raises `KeyboardInterrupt`.  The handlers of before come back on leaving.
    """

    def __init__(self) -> None:
        self._stopped = False

    def __call__(self) -> bool:
        return self._stopped

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._handle) for number in SIGNALS}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._stopped:
            raise KeyboardInterrupt
        self._stopped = True
