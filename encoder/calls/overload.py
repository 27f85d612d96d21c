"""Overload control of a live call: whether it keeps up with its source."""

# A call that lags more than this leaves out what it can until it has caught up, and for so much
# longer.
LAG_LIMIT_S, HOLD_OFF_S = 0.1, 1.0
# Frames that wait for their packet are fitted again with new modes until a frame has taken this
# share of its time; before a packet is coded, after which it is too late, all of it.
REFIT_TIME_SHARE, LAST_REFIT_TIME_SHARE = 0.65, 1.0
# The lag grows no larger: a camera drops the frames that are not fetched.
MAX_LAG_S = 0.3


class OverloadController:
    """Adds up how much longer frames take than they may.

    period_s: from frame to frame.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._lag_s = self._hold_off_s = 0.0

    @property
    def has_headroom(self) -> bool:
        """Whether the next frame may take its full time."""
        return self._hold_off_s <= 0

    def may_refit(self, passed_s: float, is_last: bool) -> bool:
        """Whether there is time to fit a waiting frame again.

        passed_s: that the frame has taken.  is_last: its packet is coded next.
        """
        share = LAST_REFIT_TIME_SHARE if is_last else REFIT_TIME_SHARE
        return self.has_headroom and passed_s < share * self._period_s

    def record_frame_time(self, seconds: float) -> None:
        """Account for a frame that took this long."""
        lag_s = self._lag_s + seconds - self._period_s
        self._lag_s = min(max(0.0, lag_s), MAX_LAG_S)
        self._hold_off_s -= self._period_s
        if self._lag_s > LAG_LIMIT_S:
            self._hold_off_s = HOLD_OFF_S
