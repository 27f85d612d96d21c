"""Counts, stage times and warnings of one call on the sending side."""

import time
from collections import Counter
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from encoder.live_model.work_level import WorkLevel
from protocol.packets import ControlKind
from shared_model.stage_timer import StageTimer


@dataclass(slots=True)
class SessionStats:
    """What the encoder reports of a call.

    frames: source frames of the call, where these are fewer than were captured; None: all.
    model_bytes, frame_bytes: payload of model and layer packets, of frame packets without voice.
    voice, voice_bytes: its codec, one of `VOICES`, and its share of the frame packets.
    packets: number of packets of any kind.
    lost_frames: number of source frames without a face.
    events: kind and source frame of what the call says of its face.
    captured: number of source frames read.
    capture_ns: `time.monotonic_ns` at which each was; empty unless `keeps_times`.
    next_index: index of the source frame after the newest; a camera may have left some out.
    timer: time of each stage.
    frame_ms: time that each source frame of a live call has taken once the call had begun, but for
        omitted ones; empty unless `keeps_times`.
    level_frames: how many source frames of a live call there were at each level of work.
    omitted_frames: of these, how many were not looked at.
    worst_lag_s: the largest lag of a live call behind its source: how late a frame was taken from a
        paced one, and what work on frames takes too long, added up after the first.
    """

    frames: int | None = None
    model_bytes: int = 0
    frame_bytes: int = 0
    voice: str = "off"
    voice_bytes: int = 0
    packets: int = 0
    lost_frames: int = 0
    events: list[tuple[ControlKind, int]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    captured: int = 0
    keeps_times: bool = True
    capture_ns: list[int] = field(default_factory=list)
    next_index: int = 0
    timer: StageTimer = field(default_factory=StageTimer)
    frame_ms: list[float] = field(default_factory=list)
    level_frames: Counter[WorkLevel] = field(default_factory=Counter)
    omitted_frames: int = 0
    worst_lag_s: float = 0.0

    @property
    def overload_levels(self) -> dict[str, int]:
        """How many source frames there were at each level of work but the full one.

        Empty if the call is not live.
        """
        levels = [level for level in WorkLevel if level and self.level_frames]
        return {level.label: self.level_frames[level] for level in levels}

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
