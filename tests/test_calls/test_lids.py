"""Lids, from a drawn film to what the decoder plays."""

from pathlib import Path

import numpy as np
import pytest
from call_contents import played
from conftest import LIVE_MODEL_BYTES, without_layers
from shots import draw

from decoder.playout.playout import PlayoutFrame
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.thesis.tracking_options import TrackingOptions
from protocol.call_file import CallReader
from protocol.model_packet import EYELIDS_FORMAT, ModelPacket
from protocol.packets import parse_packet
from protocol.summary import summarise
from shared_model.parameters import EAU_INDEX, LID_EAUS

BLINK = 15
SCRIPT = """
width = 320
height = 240
fps = 25
seconds = 1.24
distance_mm = 420
noise = 1
[[key]]
time = 0.3
eau = { lid_left = 0, lid_right = 0 }
[[key]]
time = 0.6
eau = { lid_left = 1, lid_right = 1 }
[[key]]
time = 0.9
eau = { lid_left = 0, lid_right = 0 }
"""


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> str:
    """Both eyes close and open again."""
    folder = tmp_path_factory.mktemp("film")
    draw(folder / "frame%03d.png", SCRIPT)
    return str(folder / "frame%03d.png")


@pytest.fixture(scope="module")
def call_with_lids(film: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lids") / "lids.rzo"
    called(film, path, lids=True)
    return path


def called(film: str, path: Path, lids: bool, frames: int | None = None) -> list[PlayoutFrame]:
    tracking = TrackingOptions(eyelids=lids)
    options = EncodeOptions(film, path, profile="thesis", tracking=tracking, max_frames=frames)
    return encoded_and_played(options, path)


def encoded_and_played(options: EncodeOptions, path: Path) -> list[PlayoutFrame]:
    encode(options, lambda done, total: None, lambda: False)
    return played(path)


def closed(frame: PlayoutFrame) -> float:
    return float(np.mean([frame.face.eau[EAU_INDEX[name]] for name in LID_EAUS]))


def test_a_blink_arrives_with_the_lids_and_only_with_them(
    film: str, call_with_lids: Path, tmp_path: Path
) -> None:
    frames = played(call_with_lids)
    # The networks see less of a drawn blink than of a real one.
    assert closed(frames[BLINK]) > closed(frames[2]) + 0.15
    assert closed(frames[-2]) < closed(frames[2]) + 0.1
    without = called(film, tmp_path / "plain.rzo", lids=False, frames=BLINK + 3)
    assert len({closed(frame) for frame in without}) == 1


def test_a_call_with_lids_says_so_and_is_accounted_for(call_with_lids: Path) -> None:
    with CallReader(call_with_lids) as reader:
        first = next(iter(reader))
    model = parse_packet(first)
    assert isinstance(model, ModelPacket) and model.call.has_eyelids and first[1] == EYELIDS_FORMAT
    summary = summarise(call_with_lids)
    assert summary.profile == "thesis" and summary.frame_bps == 960
    packets = summary.frame_packets
    assert summary.groups == pytest.approx(
        {"pose": 6 * packets, "expression": 4 * packets, "lids": 2 * packets}
    )


def test_a_live_call_shows_the_first_blink_at_its_usual_rate(film: str, tmp_path: Path) -> None:
    path = tmp_path / "live.rzo"
    options = EncodeOptions(film, path, live=True, bitrate=800.0, model_bytes=LIVE_MODEL_BYTES)
    with without_layers():
        lids = [closed(frame) for frame in encoded_and_played(options, path)]
    # At its height a mode that has just been learned may already show half of it.
    assert max(lids[BLINK - 2 : BLINK + 3]) > 0.7 and min(lids[BLINK - 2 : BLINK + 3]) > 0.5
    assert np.mean(lids[:4]) < 0.2 and np.mean(lids[-4:]) < 0.2
