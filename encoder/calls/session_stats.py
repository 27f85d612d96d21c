"""Counts, stage times and warnings of one call on the sending side."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from shared_model.stage_timer import StageTimer


@dataclass(slots=True)
class SessionStats:
    """What the encoder reports of a call.

    frames: source frames of the call, where these are fewer than were captured; None: all.
    model_bytes, frame_bytes: payload of model and layer packets, of frame packets without voice.
    voice, voice_bytes: its codec, one of `VOICES`, and its share of the frame packets.
    packets: number of packets of any kind.
    lost_frames: number of source frames without a face.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    next_index: index of the source frame after the newest; a camera may have left some out.
    timer: time of each stage.
    """

    frames: int | None = None
    model_bytes: int = 0
    frame_bytes: int = 0
    voice: str = "off"
    voice_bytes: int = 0
    packets: int = 0
    lost_frames: int = 0
    warnings: list[str] = field(default_factory=list)
    capture_ns: list[int] = field(default_factory=list)
    next_index: int = 0
    timer: StageTimer = field(default_factory=StageTimer)

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Add the time that the `with` block takes to stage `name`."""
        return self.timer.stage(name)

    def warn(self, message: str) -> None:
        """Add a warning; one that is there already is not repeated."""
        if message not in self.warnings:
            self.warnings.append(message)
