"""Counts, stage times and warnings of one call on the sending side."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass(slots=True)
class SessionStats:
    """What the encoder reports of a call.

    frames: source frames of the call, where these are fewer than were captured; None: all.
    model_bytes, frame_bytes: payload of model and layer packets, of frame packets.
    packets: number of packets of any kind.
    lost_frames: number of source frames without a face.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    stage_ns: time spent in each stage, ns.
    """

    frames: int | None = None
    model_bytes: int = 0
    frame_bytes: int = 0
    packets: int = 0
    lost_frames: int = 0
    warnings: list[str] = field(default_factory=list)
    capture_ns: list[int] = field(default_factory=list)
    stage_ns: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the `with` block takes to stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            self.stage_ns[name] = self.stage_ns.get(name, 0) + time.perf_counter_ns() - start

    def warn(self, message: str) -> None:
        """Add a warning; one that is there already is not repeated."""
        if message not in self.warnings:
            self.warnings.append(message)
