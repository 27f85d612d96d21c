"""The thesis profile with texture modes: the tracker's four actuators, the person's appearance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of
from shots import draw, talking

from decoder.pipeline import DecodeOptions, decode
from decoder.playout.frame_decoder import frame_decoder_for
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.options import EncodeOptions
from encoder.pipeline import EncodeRun, encode, first_pass
from loopback.quality.video_quality import TrackedFaceMask, measure_quality
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket
from protocol.summary import summarise
from shared_model.errors import UserError
from shared_model.parameters import EAU_INDEX, EAUS, THESIS_EAUS

FRAMES, FPS, MODES = 45, 25, 4
LIGHT = """
[[key]]
time = 0.7
light = { side = 0.0, brightness = 1.0 }
[[key]]
time = 1.3
light = { side = 0.8, brightness = 0.8 }
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> Path:
    path = tmp_path_factory.mktemp("modes") / "clip.mkv"
    draw(path, talking(FRAMES / FPS, FPS, smile=0.6) + LIGHT)
    return path


@pytest.fixture(scope="module")
def options(clip: Path) -> EncodeOptions:
    return EncodeOptions(
        str(clip), clip.with_name("modes.rzo"), profile="thesis", texture_modes=MODES
    )


@pytest.fixture(scope="module")
def call(options: EncodeOptions) -> Path:
    encode(options, lambda done, total: None, lambda: False)
    assert isinstance(options.output, Path)
    return options.output


def face_psnr_db(clip: Path, call: Path) -> float:
    video = call.with_suffix(".mkv")
    decode(DecodeOptions(call, output=video), lambda done, total: None, lambda: False)
    nothing = lambda done, total: None  # noqa: E731
    psnr = measure_quality(str(clip), str(video), TrackedFaceMask(), nothing).face_psnr_db
    assert psnr is not None
    return psnr


def test_modes_show_what_one_texture_does_not_at_the_same_rate(
    clip: Path, call: Path, options: EncodeOptions
) -> None:
    literal = clip.with_name("literal.rzo")
    plain = replace(options, output=literal, texture_modes=0)
    encode(plain, lambda done, total: None, lambda: False)
    assert face_psnr_db(clip, call) > face_psnr_db(clip, literal) + 2
    frames, expected = summarise(call), summarise(literal)
    assert frames.frame_bps <= expected.frame_bps


def test_only_the_actuators_of_the_thesis_move(call: Path) -> None:
    packets = packets_of(call)
    model = next(packet for packet in packets if isinstance(packet, ModelPacket))
    assert model.call.frame_step == 3 and model.call.profile == "default"
    assert 1 <= len(parse_transform(model.profile_data).modes) <= MODES
    decoder, moved = frame_decoder_for(model), np.zeros(len(EAUS))
    payloads = [packet.payload for packet in packets if isinstance(packet, FramePacket)]
    for number, payload in enumerate(payloads):
        for timed in decoder.decode(number, payload):
            moved = np.maximum(moved, np.abs(timed.face.eau - model.reference_face.eau))
    sent = [EAU_INDEX[name] for name in THESIS_EAUS]
    np.testing.assert_allclose(np.delete(moved, sent), 0, atol=0.1)
    assert moved[EAU_INDEX["jaw_drop"]] > 0.2


def test_a_source_without_an_end_is_refused(clip: Path, options: EncodeOptions) -> None:
    stats, callbacks = SessionStats(), SessionCallbacks(lambda done, total: None, lambda: False)
    with open_source(str(clip)) as capture:
        capture.is_live = True
        with pytest.raises(UserError, match="--texture-modes looks at a whole recording"):
            first_pass(EncodeRun(options, capture, stats, callbacks))
