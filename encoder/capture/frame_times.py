"""When the frames of a recorded source are shown: at a constant rate, or each at its own time."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from protocol.frames.frame_times import MAX_TICKS, TICKS_PER_FRAME, TimesPacket
from protocol.limits import MAX_TICK_STEP, MAX_TIMED_FRAMES
from shared_model.arrays import Array

# A source whose frames come no further from their times at a constant rate than this share of a
# frame, or than the rounding to milliseconds of some containers, has a constant rate.
CONSTANT_FRAMES, CONSTANT_S = 0.25, 0.002
DEFAULT_FPS = Fraction(25)


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """The times of a source's frames.

    fps: of a constant rate: the source's own, or the mean of one whose rate varies.
    ticks: deviation of each frame from its time at `fps`, in 1 / `TICKS_PER_FRAME` of a frame;
        empty: the rate is constant.  Frames beyond the last have its deviation.
    """

    fps: Fraction
    ticks: tuple[int, ...] = ()

    def time_s(self, frame: int) -> float:
        """The time of source frame `frame`, seconds from the first one."""
        ticks = self.ticks[min(frame, len(self.ticks) - 1)] if self.ticks else 0
        return float((frame + Fraction(ticks, TICKS_PER_FRAME)) / self.fps)

    def packet(self, first: int) -> TimesPacket | None:
        """The times of the frames from `first` on that fit into a packet; None: known without."""
        ticks = self.ticks[first : first + MAX_TIMED_FRAMES]
        return TimesPacket(0, first, ticks) if ticks else None


def frame_times(times_s: Sequence[Fraction], stated_fps: Fraction) -> FrameTimes:
    """The frame rate of a source and, if it varies, when each frame is shown.

    times_s: of all frames, in any order; empty if they are not known.
    stated_fps: the rate that the container states.
    Times that are not all different, or whose mean rate is not usable, are not believed.
    """
    ordered = sorted(times_s)
    span_s = ordered[-1] - ordered[0] if ordered else Fraction(0)
    if len(set(ordered)) < max(len(times_s), 2):
        return FrameTimes(stated_fps)
    mean = float((len(ordered) - 1) / span_s)
    if not is_usable_fps(mean):
        return FrameTimes(stated_fps)
    mean_fps = exact_fps(mean)
    shown_s = np.array([float(time_s - ordered[0]) for time_s in ordered])
    for fps in (stated_fps, mean_fps):
        away_s = np.abs(shown_s - np.arange(len(shown_s)) / float(fps))
        if away_s.max() <= max(CONSTANT_FRAMES / float(fps), CONSTANT_S):
            return FrameTimes(fps)
    return FrameTimes(mean_fps, _ticks(shown_s * float(mean_fps)))


def _ticks(shown_frames: Array) -> tuple[int, ...]:
    """Deviations in ticks, each within `MAX_TICK_STEP` of the one before.

    shown_frames: (n,) times in frames of the mean rate.
    """
    away = np.rint(TICKS_PER_FRAME * (shown_frames - np.arange(len(shown_frames))))
    ticks = [0]
    for wanted in np.clip(away[1:], -MAX_TICKS, MAX_TICKS).astype(int).tolist():
        # Two frames in one tick would be one picture in a file.
        earliest = ticks[-1] - TICKS_PER_FRAME + 1
        ticks.append(max(min(wanted, ticks[-1] + MAX_TICK_STEP), earliest))
    return tuple(ticks)


def is_usable_fps(fps: float) -> bool:
    """Whether a stated frame rate is plausible."""
    return bool(np.isfinite(fps)) and 1 <= fps <= 240


def exact_fps(fps: float) -> Fraction:
    """The exact rate of a rounded one (29.97 -> 30000/1001); 25 if it is not usable."""
    if not is_usable_fps(fps):
        return DEFAULT_FPS
    for denominator in (1, 1001):
        numerator = round(fps * denominator / 1000) * 1000 if denominator > 1 else round(fps)
        if abs(numerator / denominator - fps) < 0.004:
            return Fraction(numerator, denominator)
    return Fraction(fps).limit_denominator(1001)
