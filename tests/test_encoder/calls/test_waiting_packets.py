"""In real time a packet waits a moment for the modes that its frames show to be missing."""

from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of, played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from protocol.call_file import CallWriter
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, parse_packet

# Of a packet; those that it waits for at this rate.
OWN, HELD = 8, 2
# Without frames in between, as of a camera that was held up.
MISSING = frozenset({30, 41, 42, *range(52, 63)})


class DatedWriter(CallWriter):
    """Notes during which source frame each frame packet was sent."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.now, self.dates = 0, list[int]()

    def send(self, packet: bytes) -> None:
        if isinstance(parse_packet(packet), FramePacket):
            self.dates.append(self.now)
        super().send(packet)


def encode(clip: Path, path: Path, missing: frozenset[int], waits: bool) -> tuple[list[int], int]:
    """The source frame during which each packet is sent, and the number of source frames."""
    with open_source(str(clip)) as capture:
        pictures = [picture for _, picture in capture]
        with DatedWriter(path) as sink, without_layers():
            stats = SessionStats()
            session = live_encoder(
                capture, sink, stats, LIVE_MODEL_BYTES, realtime=True, waits_for_modes=waits
            )
            for index, picture in enumerate(pictures):
                sink.now = index
                if index not in missing:
                    session.frame(index, picture)
            sink.now = len(pictures)
            session.end(len(pictures))
            return sink.dates, len(pictures)


def starts(path: Path) -> list[int]:
    """The first frame of each version."""
    return [
        packet.call.start_frame for packet in packets_of(path) if isinstance(packet, ModelPacket)
    ]


@pytest.mark.parametrize("waits", [True, False])
def test_it_is_coded_two_frames_late_but_the_first_and_the_last_of_a_model_at_once(
    talking_clip: Path, networks: Path, tmp_path: Path, waits: bool
) -> None:
    path = tmp_path / "call.rzo"
    dates, frames = encode(talking_clip, path, frozenset(), waits)
    first, update = starts(path)
    expected = []
    for begin, end in ((first, update), (update, frames)):
        expected.append(begin)
        for last in range(begin + OWN, end, OWN):
            at_once = not waits or last == update - 1
            expected.append(min(last + (0 if at_once else HELD), frames))
        if (end - begin - 1) % OWN:
            expected.append(end)
    assert first == 0 and dates == expected
    assert [frame.index for frame in played(path)] == list(range(frames))


def test_frames_that_a_camera_left_out_are_filled(
    talking_clip: Path, networks: Path, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    dates, frames = encode(talking_clip, path, MISSING, True)
    assert dates == sorted(dates)
    shown = played(path)
    assert [frame.index for frame in shown] == list(range(frames))
    assert np.isfinite([frame.face.eau for frame in shown]).all()
    assert not any(frame.frozen for frame in shown)
