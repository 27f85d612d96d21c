"""The clock of a page, against that of this host."""

import time
from collections.abc import Callable

# A page's time that is further from now is none: its clock has been set since it was loaded, or
# this host's.
MAX_AWAY_S = 5.0


class PageClock:
    """Converts a page's times, ms since 1970, to `time.monotonic` of this host, seconds.

    A page goes on counting from when it was loaded, whatever is done to the clock.  One whose times
    are more than `MAX_AWAY_S` from now has another start: from then on that is taken instead.
    """

    def __init__(
        self,
        monotonic: Callable[[], float] = time.monotonic,
        since_1970: Callable[[], float] = time.time,
    ) -> None:
        self._monotonic = monotonic
        self._epoch_s = monotonic() - since_1970()

    def taken_s(self, page_ms: float) -> float:
        """The time of something that a page has just sent."""
        time_s, now_s = page_ms / 1000 + self._epoch_s, self._monotonic()
        if abs(time_s - now_s) > MAX_AWAY_S:
            self._epoch_s = now_s - page_ms / 1000
            return now_s
        return time_s

    def page_ms(self, time_s: float) -> float:
        """A time of this host by the page's clock."""
        return 1000 * (time_s - self._epoch_s)
