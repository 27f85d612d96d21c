"""Calls in which the person changes: each has a model of their own, recorded and live."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ClipFrames, without_layers

import risorius
from decoder.pipeline import DecodeOptions, decode
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from encoder.detection.tflite import find_segmentation_network
from protocol.call_file import CallReader
from protocol.packets import ControlKind, ControlPacket, parse_packet
from protocol.summary import summarise
from shared_model.arrays import Picture

WIDTH, HEIGHT = 320, 240
PERSON_GONE = ControlKind.PERSON_GONE
FIRST, GAP, SECOND = 16, 15, 34
# Of a second person whose model is learned from the whole recording.
FEW = 16
# The face of the one in place of that of the other gives less, the right one more, dB.
OTHER_DB, SAME_DB = 14.0, 20.0


def fitted(picture: Picture) -> Picture:
    """The middle of a picture in the size of the call."""
    scale = max(WIDTH / picture.shape[1], HEIGHT / picture.shape[0])
    large = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    top, left = (large.shape[0] - HEIGHT) // 2, (large.shape[1] - WIDTH) // 2
    return np.asarray(large[top : top + HEIGHT, left : left + WIDTH], np.uint8)


@pytest.fixture(scope="module")
def make_clip(
    networks: Path, clip_frames: ClipFrames, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[int, int], Path]:
    """One person, so many frames of nothing, so many of another person."""

    def make(gap: int, second: int) -> Path:
        path = tmp_path_factory.mktemp("people") / "clip.mkv"
        nobody = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        frames = [fitted(frame) for frame in clip_frames("smile.mp4", FIRST)]
        frames += gap * [nobody]
        frames += [fitted(frame) for frame in clip_frames("akiyo.mp4", second)]
        with open_sink(path, WIDTH, HEIGHT, Fraction(25)) as sink:
            for frame in frames:
                sink.write(frame)
        return path

    return make


def likeness(source: Path, call: Path, folder: Path) -> list[float]:
    """PSNR of the middle of each picture, dB."""
    output = folder / "decoded.mkv"
    report = decode(DecodeOptions(call, output=output), lambda *_: None, lambda: False)
    assert report.lost_frames == report.late_packets == report.lost_packets == 0
    with open_source(str(source)) as originals, open_source(str(output)) as copies:
        pairs = zip(originals, copies, strict=True)
        errors = [a[60:180, 80:240].astype(float) - b[60:180, 80:240] for (_, a), (_, b) in pairs]
    return [float(10 * np.log10(255**2 / (error**2).mean())) for error in errors]


def test_a_recorded_call_has_a_model_for_each_person(
    make_clip: Callable[[int, int], Path], tmp_path: Path
) -> None:
    source, call = make_clip(GAP, FEW), tmp_path / "call.rzo"
    with without_layers():
        risorius.encode(source, call, model_bytes=6000)
    assert summarise(call).model_packets == 2
    psnr_db = likeness(source, call, tmp_path)
    assert len(psnr_db) == FIRST + GAP + FEW
    for part in (psnr_db[:FIRST], psnr_db[FIRST + GAP :]):
        assert min(part) > SAME_DB


def test_a_live_call_begins_a_new_model_for_somebody_else(
    make_clip: Callable[[int, int], Path], tmp_path: Path
) -> None:
    source, call = make_clip(0, SECOND), tmp_path / "call.rzo"
    with without_layers():
        risorius.encode(source, call, model_bytes=6000, live=True)
    psnr_db = likeness(source, call, tmp_path)
    assert min(psnr_db[:FIRST]) > SAME_DB and min(psnr_db[FIRST + 25 :]) > SAME_DB
    assert psnr_db[FIRST] < OTHER_DB


def test_who_leaves_a_live_call_fades_from_the_picture(
    make_clip: Callable[[int, int], Path], tmp_path: Path
) -> None:
    if find_segmentation_network() is None:
        pytest.skip("needs the segmentation network")
    source, call = make_clip(25, 0), tmp_path / "call.rzo"
    risorius.encode(source, call, model_bytes=6000, live=True)
    with CallReader(call) as reader:
        packets = [parse_packet(data) for data in reader]
    gone = [p.frame for p in packets if isinstance(p, ControlPacket) and p.kind == PERSON_GONE]
    assert len(gone) == 1 and FIRST < gone[0] < FIRST + 25


def test_who_comes_back_keeps_the_model(clip_frames: ClipFrames, tmp_path: Path) -> None:
    source, call = tmp_path / "clip.mkv", tmp_path / "call.rzo"
    frames = [fitted(frame) for frame in clip_frames("smile.mp4", 28)]
    nobody = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    with open_sink(source, WIDTH, HEIGHT, Fraction(25)) as sink:
        for frame in [*frames[:16], *(15 * [nobody]), *frames[12:]]:
            sink.write(frame)
    with without_layers():
        report = risorius.encode(source, call, model_bytes=6000)
    assert summarise(call).model_packets == 1
    assert report.lost_frames <= 15 + 5


def test_a_head_that_turns_away_is_found_within_five_frames(clips: Path, tmp_path: Path) -> None:
    """Three quarters of a turn, played twice, with a black picture of a second in between."""
    source, call = tmp_path / "clip.mkv", tmp_path / "call.rzo"
    with open_source(str(clips / "profile.gif")) as capture:
        frames = [frame for _, frame in capture]
    with open_sink(source, frames[0].shape[1], frames[0].shape[0], Fraction(12)) as sink:
        for frame in [*frames, *(12 * [np.zeros_like(frames[0])]), *frames[::-1]]:
            sink.write(frame)
    with without_layers():
        report = risorius.encode(source, call, model_bytes=6000)
    assert 12 <= report.lost_frames <= 12 + 5
    assert summarise(call).model_packets == 1
