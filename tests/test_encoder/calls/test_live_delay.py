"""A live call that waits: its models are trained from frames after those that are coded."""

import time
from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of, played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.detection.tflite import find_segmentation_network
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from protocol.call_file import CallWriter
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, LayerPacket, Packet
from protocol.pictures.layered_background import is_layered
from risorius.cli import main

FPS, FRAMES = 25, 34


def encode_with_delay(clip: Path, output: Path, delay_s: float, frames: int) -> list[Packet]:
    options = EncodeOptions(
        str(clip),
        output,
        live=True,
        delay_s=delay_s,
        model_bytes=LIVE_MODEL_BYTES,
        max_frames=frames,
    )
    encode(options, lambda done, total: None, lambda: False)
    return packets_of(output)


def test_the_first_model_knows_what_follows(talking_clip: Path, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    packets = encode_with_delay(talking_clip, path, 1.2, FRAMES)
    (model,) = (packet for packet in packets if isinstance(packet, ModelPacket))
    assert any(parse_transform(model.profile_data).modes)
    assert is_layered(model.background) == (find_segmentation_network() is not None)
    frames = played(path)
    assert [frame.index for frame in frames] == list(range(FRAMES))
    assert frames[0].face.modes.any()
    assert isinstance(packets[-1], ControlPacket) and packets[-1].kind is ControlKind.END


def test_a_clip_that_is_shorter_than_the_delay_is_a_whole_call(
    talking_clip: Path, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    with without_layers():
        encode_with_delay(talking_clip, path, 10, 6)
    assert [frame.index for frame in played(path)] == list(range(6))


def test_in_real_time_frames_wait_and_the_model_does_not(
    talking_clip: Path, networks: Path, tmp_path: Path
) -> None:
    """Frames before the first face wait, too.  Modes are learned from those that wait."""
    path, before, delay = tmp_path / "call.rzo", 3, 20
    with open_source(str(talking_clip)) as capture:
        pictures = [picture for _, picture in capture][: FRAMES - before]
        pictures = [np.full_like(pictures[0], 90)] * before + pictures
        stats, sent = SessionStats(), list[tuple[bool, bool]]()
        with CallWriter(path) as sink, without_layers():
            session = live_encoder(
                capture,
                sink,
                stats,
                LIVE_MODEL_BYTES,
                realtime=True,
                delay_s=delay / FPS,
                clock=time.monotonic,
            )
            for index, picture in enumerate(pictures):
                session.frame(index, picture)
                sent.append((stats.sent.model_bytes > 0, stats.sent.frame_bytes > 0))
                assert session.started == (index >= before)
            session.end(FRAMES)
    assert sent == [(index >= before, index >= before + delay) for index in range(FRAMES)]
    kinds = [type(packet) for packet in packets_of(path)]
    modes = kinds.index(FramePacket) - 1
    assert modes > 0 and kinds[: modes + 1] == [ModelPacket] + modes * [LayerPacket]
    assert [frame.index for frame in played(path)] == list(range(FRAMES))


def test_a_delay_of_a_recorded_call_is_refused(
    talking_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["encode", str(talking_clip), "-o", str(tmp_path / "call.rzo"), "--delay", "1"]
    assert main(line) == 2
    assert "--delay 1 is about live calls" in capsys.readouterr().err
    assert main([*line, "--profile", "thesis"]) == 2
    assert "--delay 1 is about the default profile" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
