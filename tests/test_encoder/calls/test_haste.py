"""A live call by a clock of its own: what it leaves out when frames take too long, and reports."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from call_contents import packets_of, played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.live_model.work_level import WorkLevel
from protocol.call_file import CallWriter
from protocol.packets import FramePacket

# Shares of a frame's time that pass from one look at the clock to the next, for so many frames: a
# frame looks twice or more.
SLOW, SLOW_FRAMES = 0.7, 40
REPEATS = 3


class SteppedClock:
    """Goes on by a step whenever it is looked at."""

    def __init__(self) -> None:
        self.now_s = self.step_s = 0.0

    def __call__(self) -> float:
        self.now_s += self.step_s
        return self.now_s


def test_frames_that_take_too_long_are_left_out_in_the_stated_order_and_counted(
    talking_clip: Path, networks: Path, tmp_path: Path
) -> None:
    path, stats, clock = tmp_path / "call.rzo", SessionStats(), SteppedClock()
    omitted = list[bool]()
    with (
        open_source(str(talking_clip)) as capture,
        CallWriter(path) as sink,
        without_layers(),
    ):
        pictures = [picture for _, picture in capture] * REPEATS
        session = live_encoder(capture, sink, stats, LIVE_MODEL_BYTES, realtime=True, clock=clock)
        for index, picture in enumerate(pictures):
            clock.step_s = SLOW / float(capture.fps) if 0 < index <= SLOW_FRAMES else 0.0
            before = stats.omitted_frames
            session.frame(index, picture)
            omitted.append(stats.omitted_frames > before)
        session.end(len(pictures))
    assert all(stats.level_frames[level] > 0 for level in WorkLevel)
    assert sum(stats.level_frames.values()) == len(pictures) - 1
    halved = sum(stats.level_frames[level] for level in WorkLevel if level.halves_frames)
    assert abs(sum(omitted) - halved / 2) <= 2
    assert not any(first and second for first, second in pairwise(omitted))
    assert len(stats.frame_ms) == len(pictures) - 1 - sum(omitted)
    assert stats.worst_lag_s > 0.1
    assert any("in haste" in warning for warning in stats.warnings)
    # The call is whole, and what was omitted lies between its neighbours.
    frames = played(path)
    assert [frame.index for frame in frames] == list(range(len(pictures)))
    assert sum(isinstance(packet, FramePacket) for packet in packets_of(path)) > 1
    jaw = np.array([frame.face.eau for frame in frames])
    assert np.isfinite(jaw).all() and not any(frame.frozen for frame in frames)
