"""Counts, stage times and warnings of one call on the sending side."""

import time
from collections import Counter
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from encoder.live_model.work_level import WorkLevel
from protocol.packets import ControlKind
from shared_model.stage_timer import StageTimer, frame_times


@dataclass(slots=True)
class SentBytes:
    """Payload of model and layer packets, of frame packets without voice; number of packets."""

    model_bytes: int = 0
    frame_bytes: int = 0
    packets: int = 0


@dataclass(slots=True)
class SentVoice:
    """Its codec, one of `VOICES`, and its share of the frame packets."""

    voice: str = "off"
    voice_bytes: int = 0


@dataclass(frozen=True, slots=True)
class LiveWork:
    """How a live call kept up with its source; nothing of any other.

    frame_ms: `frame_times`: how long a source frame has taken once the call had begun.
    overloaded_frames: frames at which something was left out for want of time.
    overload_levels: of these, how many there were at each `WorkLevel`.
    omitted_frames: of these, how many were not looked at.
    worst_lag_ms: the largest lag behind the source, see `SessionStats.worst_lag_s`.
    """

    frame_ms: dict[str, float]
    overloaded_frames: int
    overload_levels: dict[str, int]
    omitted_frames: int
    worst_lag_ms: float


@dataclass(slots=True)
class SessionStats:
    """What the encoder reports of a call.

    frames: source frames of the call, where these are fewer than were captured; None: all.
    lost_frames: number of source frames without a face.
    events: kind and source frame of what the call says of its face.
    captured: number of source frames read.
    capture_ns: `time.monotonic_ns` at which each was; empty unless `keeps_times`.
    next_index: index of the source frame after the newest; a camera may have left some out.
    timer: time of each stage.
    frame_ms: time that each source frame of a live call has taken once the call had begun, but for
        omitted ones; empty unless `keeps_times`.
    missed_residuals: packets of a live call whose picture residual was not coded in time.
    level_frames: how many source frames of a live call there were at each level of work.
    omitted_frames: of these, how many were not looked at.
    worst_lag_s: the largest lag of a live call behind its source: how late a frame was taken from a
        paced one, and what work on frames takes too long, added up after the first.
    """

    frames: int | None = None
    sent: SentBytes = field(default_factory=SentBytes)
    speech: SentVoice = field(default_factory=SentVoice)
    lost_frames: int = 0
    events: list[tuple[ControlKind, int]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    captured: int = 0
    keeps_times: bool = True
    capture_ns: list[int] = field(default_factory=list)
    next_index: int = 0
    timer: StageTimer = field(default_factory=StageTimer)
    frame_ms: list[float] = field(default_factory=list)
    missed_residuals: int = 0
    level_frames: Counter[WorkLevel] = field(default_factory=Counter)
    omitted_frames: int = 0
    worst_lag_s: float = 0.0

    @property
    def work(self) -> LiveWork:
        """How the call has kept up so far."""
        levels = [level for level in WorkLevel if level and self.level_frames]
        overloads = {level.label: self.level_frames[level] for level in levels}
        return LiveWork(
            frame_times(self.frame_ms),
            sum(overloads.values()),
            overloads,
            self.omitted_frames,
            1000 * self.worst_lag_s,
        )

    def note_captured(self, index: int) -> None:
        """Count a source frame that has been read."""
        self.captured, self.next_index = self.captured + 1, index + 1
        if self.keeps_times:
            self.capture_ns.append(time.monotonic_ns())

    def note_frame(self, seconds: float, lag_s: float, level: WorkLevel, is_omitted: bool) -> None:
        """Count a source frame of a live call, and keep the time that it has taken.

        lag_s: of the call after it.
        """
        self.level_frames[level] += 1
        self.note_lag(lag_s)
        self.omitted_frames += is_omitted
        if self.keeps_times and not is_omitted:
            self.frame_ms.append(1000 * seconds)

    def note_lag(self, seconds: float) -> None:
        """Note how far a live call is behind its source."""
        self.worst_lag_s = max(self.worst_lag_s, seconds)

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Add the time that the `with` block takes to stage `name`."""
        return self.timer.stage(name)

    def warn(self, message: str) -> None:
        """Add a warning; one that is there already is not repeated."""
        if message not in self.warnings:
            self.warnings.append(message)
