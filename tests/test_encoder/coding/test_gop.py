"""Temporal decimation: fewer coded frames, and a decoded picture for every source frame."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from call_contents import packets_of, played
from conftest import without_layers
from hypothesis import given
from hypothesis import strategies as st
from shots import draw

from decoder.pipeline import DecodeOptions, decode
from encoder.coding.gop import FRAMES_PER_PACKET, GopStructure, gop_for_fps
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.report import EncodeReport
from loopback.quality.video_quality import face_mask_finder, measure_quality
from protocol.limits import MAX_FRAME_STEP
from protocol.model_packet import ModelPacket
from protocol.packets import ControlPacket, FramePacket
from protocol.summary import summarise
from shared_model.parameters import EAU_INDEX

FRAMES, START, LOST = 44, 1, range(20, 30)
MODEL_BYTES, BITRATE = 4000, 1500.0
SCRIPT = """
width = 160
height = 120
fps = 25
seconds = 1.76
distance_mm = 420
noise = 1
[[key]]
time = 0
pose = { yaw = -6 }
eau = { jaw_drop = 0 }
[[key]]
time = 0.6
pose = { yaw = 6 }
eau = { jaw_drop = 0.6 }
[[key]]
time = 1.76
pose = { yaw = -4 }
eau = { jaw_drop = 0.1 }
"""


@given(st.fractions(Fraction(1, 100), 1000), st.floats(0.01, 2000))
def test_no_other_step_is_nearer_to_the_target_rate(source: Fraction, wanted: float) -> None:
    found = gop_for_fps(source, wanted)
    error = abs(found.coded_fps(source) - Fraction(wanted))
    if wanted >= source:
        assert found == GopStructure()
    for step in {found.frame_step - 1, found.frame_step + 1} & set(range(1, MAX_FRAME_STEP + 1)):
        if wanted < source:
            assert abs(source / step - Fraction(wanted)) >= error * Fraction(1 - 1e-9)


def test_the_lowest_target_rate_has_the_longest_step() -> None:
    assert gop_for_fps(Fraction(30), 5e-324).frame_step == MAX_FRAME_STEP


@pytest.mark.parametrize(
    ("wanted", "step", "coded"), [(None, 1, 8), (30, 1, 8), (15, 2, 4), (10, 3, 3), (2, 15, 1)]
)
def test_packets_span_the_same_time_at_any_coded_rate(
    wanted: float | None, step: int, coded: int
) -> None:
    found = gop_for_fps(Fraction(30000, 1001), wanted)
    assert found == GopStructure(step, coded)
    assert step > FRAMES_PER_PACKET or abs(step * coded - FRAMES_PER_PACKET) <= 1


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> str:
    """A clip without a face in its first frame and in some frames later."""
    folder = tmp_path_factory.mktemp("clip")
    draw(folder / "frame%03d.png", SCRIPT)
    for index in (*range(START), *LOST):
        blank = np.full((120, 160, 3), 90, np.uint8)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), blank)
    return str(folder / "frame%03d.png")


def encoded(clip: str, output: Path, fps: float, live: bool) -> EncodeReport:
    options = EncodeOptions(
        clip,
        output,
        profile="default",
        bitrate=BITRATE,
        fps=fps,
        live=live,
        model_bytes=MODEL_BYTES,
    )
    with without_layers():
        return encode(options, lambda done, total: None, lambda: False)


@pytest.mark.parametrize(("live", "fps", "step"), [(False, 12.5, 2), (True, 8, 3)])
def test_every_kth_frame_is_coded_and_every_frame_is_drawn(
    clip: str, live: bool, fps: float, step: int, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    report = encoded(clip, path, fps, live)
    assert report.fps == 25 and report.coded_fps == pytest.approx(25 / step)
    summary = summarise(path)
    assert (summary.frames, summary.fps) == (FRAMES, 25)
    assert summary.coded_fps == pytest.approx(25 / step)
    assert summary.record_bps <= BITRATE
    packets = packets_of(path)
    model = next(packet for packet in packets if isinstance(packet, ModelPacket))
    assert model.call.frame_step == step
    per_packet = step * model.call.frames_per_packet
    coded = 1 + per_packet * (sum(isinstance(packet, FramePacket) for packet in packets) - 1)
    assert FRAMES - START - step < coded <= FRAMES - START + 2 * per_packet
    told = [packet.frame for packet in packets if isinstance(packet, ControlPacket)]
    assert all((frame - START) % step == 0 for frame in told[:-1])
    frames = played(path)
    assert [frame.index for frame in frames] == list(range(FRAMES))
    jaw = [frame.face.eau[EAU_INDEX["jaw_drop"]] for frame in frames]
    assert jaw[15] > jaw[2] + 0.15
    # Frames between coded ones are interpolated linearly.
    middle = [START + step * i for i in range(2, 5)]
    assert jaw[middle[0] + 1] == pytest.approx(
        jaw[middle[0]] + (jaw[middle[1]] - jaw[middle[0]]) / step
    )
    video = tmp_path / "d%03d.png"
    decoded = decode(DecodeOptions(path, output=video), lambda done, total: None, lambda: False)
    assert decoded.frames == FRAMES and not decoded.warnings
    find_face_mask = face_mask_finder(pytest.fail)
    quality = measure_quality(clip, str(video), find_face_mask, lambda done, total: None)
    assert quality.face_psnr_db is not None and quality.face_psnr_db > (22 if live else 26)


@pytest.mark.parametrize("live", [False, True])
def test_low_delay_halves_the_frames_of_a_packet(clip: str, tmp_path: Path, live: bool) -> None:
    path = tmp_path / "low.rzo"
    options = EncodeOptions(
        clip, path, live=live, low_delay=True, model_bytes=MODEL_BYTES, max_frames=8
    )
    with without_layers():
        encode(options, lambda done, total: None, lambda: False)
    packets = packets_of(path)
    model = next(packet for packet in packets if isinstance(packet, ModelPacket))
    assert model.call.frames_per_packet == 4
    first = model.call.start_frame
    coded = sum(isinstance(packet, FramePacket) for packet in packets)
    # One frame alone, then four at a time.
    assert coded == 1 + -(-(8 - first - 1) // 4)
