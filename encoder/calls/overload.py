"""Whether a live call keeps up with its source."""

# A call this far behind does without what can be left out until it has caught up, and so much
# longer.
BEHIND_S, RESTING_S = 0.1, 5.0
# No call is farther behind: a camera drops what is not fetched.
MOST_BEHIND_S = 0.3


class Haste:
    """Adds up the time that frames take.

    period_s: from frame to frame.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._behind_s = self._resting_s = 0.0

    @property
    def has_time(self) -> bool:
        """Whether the next frame may take longer than it must."""
        return self._resting_s <= 0

    def spent(self, seconds: float) -> None:
        """A frame has taken this long."""
        behind_s = self._behind_s + seconds - self._period_s
        self._behind_s = min(max(0.0, behind_s), MOST_BEHIND_S)
        self._resting_s -= self._period_s
        if self._behind_s > BEHIND_S:
            self._resting_s = RESTING_S
