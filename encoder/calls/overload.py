"""Overload control of a live call: which of its work it leaves out while it lags."""

import logging
from collections.abc import Mapping
from math import inf

from encoder.live_model.work_level import WorkLevel

_log = logging.getLogger(__name__)

# A call that lags by more than the first goes up a level, and up another one if its lag has not
# fallen after the second.
LAG_LIMIT_S, RESPONSE_S = 0.1, 0.25
# A call that has lagged less than the first for the second goes a level down.
CAUGHT_UP_S, HOLD_OFF_S = 0.05, 1.0
# Frames that wait for their packet are fitted again with new modes until a frame has taken this
# share of its time; before a packet is coded, after which it is too late, all of it.
REFIT_TIME_SHARE, LAST_REFIT_TIME_SHARE = 0.65, 1.0
# A call that is later than this at any time says so even if it leaves nothing out.
LATE_S = 1.0

# What a report says is done at a level, besides what is done at those before.
LEVEL_DESCRIPTIONS = {
    WorkLevel.HALF_THE_FRAMES: "every second one skipped",
    WorkLevel.NO_IMAGE_FIT: "fitted by texels only",
    WorkLevel.HALF_RESOLUTION: "at half the resolution",
}


class OverloadController:
    """Sets the level of work by how much longer frames take than they may.

    period_s: from frame to frame; infinite: they may take any time.
    max_lag_s: the lag grows no larger.
    """

    def __init__(self, period_s: float, max_lag_s: float = inf) -> None:
        self._period_s, self._max_lag_s = period_s, max_lag_s
        self._level = WorkLevel.FULL
        self._lag_s = self._checked_lag_s = 0.0
        self._since_check_s, self._caught_up_s = inf, 0.0

    @property
    def level(self) -> WorkLevel:
        """Of the next frame."""
        return self._level

    def may_refit(self, passed_s: float, is_last: bool) -> bool:
        """Whether there is time to fit a waiting frame again.

        passed_s: that the frame has taken.  is_last: its packet is coded next.
        """
        share = LAST_REFIT_TIME_SHARE if is_last else REFIT_TIME_SHARE
        return self._level.fits_image and passed_s < share * self._period_s

    def record_frame_time(self, seconds: float) -> float:
        """Account for a frame that took this long; the lag after it, seconds."""
        self._lag_s = min(max(0.0, self._lag_s + seconds - self._period_s), self._max_lag_s)
        self._since_check_s += self._period_s
        self._caught_up_s = self._caught_up_s + self._period_s if self._lag_s < CAUGHT_UP_S else 0.0
        if self._lag_s > LAG_LIMIT_S:
            self._raise_unless_falling()
        elif self._level and self._caught_up_s >= HOLD_OFF_S:
            self._level = WorkLevel(self._level - 1)
            _log.info("less haste: %s", self._level.label)
            self._checked_lag_s = self._caught_up_s = 0.0
        return self._lag_s

    def _raise_unless_falling(self) -> None:
        if self._since_check_s < RESPONSE_S:
            return
        is_falling = self._lag_s < self._checked_lag_s
        self._checked_lag_s, self._since_check_s = self._lag_s, 0.0
        if not is_falling and self._level is not max(WorkLevel):
            self._level = WorkLevel(self._level + 1)
            _log.info("more haste, %.2f s late: %s", self._lag_s, self._level.label)


def overload_warning(level_frames: Mapping[WorkLevel, int], worst_lag_s: float) -> str | None:
    """A warning of what was left out for want of time, and how often, or of a long lag alone."""
    hurried = {level: count for level, count in level_frames.items() if level and count}
    late = f"the call up to {1000 * worst_lag_s:.0f} ms late"
    if not hurried:
        return f"no frame was encoded in haste, but {late}" if worst_lag_s > LATE_S else None
    parts = ", ".join(f"{LEVEL_DESCRIPTIONS[level]} {hurried[level]}" for level in sorted(hurried))
    frames = f"{sum(hurried.values())} of {sum(level_frames.values())} frames"
    return f"{frames} were encoded in haste, {late}: {parts}"
