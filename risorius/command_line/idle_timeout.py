"""When a command that waits for a call gives up."""

import time
from collections.abc import Callable

Progress = Callable[[int, int | None], None]


class IdleTimeout:
    """A question to stop: also yes once no picture has come for `timeout_s`; 0 waits for ever."""

    def __init__(
        self,
        timeout_s: float,
        stop: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.timeout_s = timeout_s
        self._stop, self._clock = stop, clock
        self._last = clock()

    @property
    def expired(self) -> bool:
        """Nothing has come for too long."""
        return 0 < self.timeout_s < self._clock() - self._last

    def __call__(self) -> bool:
        return self._stop() or self.expired

    def watch(self, progress: Progress) -> Progress:
        """`progress`, with a note of the time whenever it is called."""

        def noted(done: int, total: int | None) -> None:
            self._last = self._clock()
            progress(done, total)

        return noted
