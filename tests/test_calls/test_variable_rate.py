"""A source whose frame rate varies: its frames keep their times from end to end."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from conftest import without_layers

import risorius
from decoder.pipeline import DecodeOptions, decode
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from protocol.call_file import CallReader

GAP_AFTER = 5


@pytest.fixture(scope="module")
def uneven(carphone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixteen frames of a face at 25/s, with a gap of half a second."""
    path = tmp_path_factory.mktemp("uneven") / "uneven.mkv"
    with (
        open_source(str(carphone)) as capture,
        open_sink(path, capture.width, capture.height, Fraction(25), is_variable=True) as sink,
    ):
        for index, frame in capture:
            if index == 16:
                break
            sink.write(frame, Fraction(index, 25) + Fraction(index > GAP_AFTER, 2))
    return path


@pytest.fixture(scope="module")
def uneven_call(uneven: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("call") / "uneven.rzo"
    with without_layers():
        risorius.encode(uneven, path, model_bytes=4000)
    return path


def times_s(path: Path) -> list[float]:
    with av.open(str(path)) as container:
        return sorted(frame.time or 0.0 for frame in container.decode(video=0))


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_decoded_frames_have_the_times_of_the_source(
    uneven: Path, uneven_call: Path, tmp_path: Path, suffix: str
) -> None:
    output = tmp_path / f"out{suffix}"
    report = decode(DecodeOptions(uneven_call, output=output), lambda *_: None, lambda: False)
    shown, expected = times_s(output), times_s(uneven)
    assert len(shown) == len(expected) == 16
    assert not report.warnings
    assert np.abs(np.subtract(shown, expected)).max() < 0.004
    assert np.diff(shown).max() > 0.5


def test_pictures_of_an_open_call_have_the_times_of_the_source(
    uneven: Path, uneven_call: Path
) -> None:
    with risorius.open_call(uneven_call) as pictures:
        shown = [picture.time_s for picture in pictures]
    assert np.abs(np.subtract(shown, times_s(uneven))).max() < 0.004


def test_a_file_of_one_rate_is_said_to_lose_the_times(uneven_call: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.avi"
    report = decode(DecodeOptions(uneven_call, output=output), lambda *_: None, lambda: False)
    assert report.frames == 16
    assert any("frame rate of the source varies" in warning for warning in report.warnings)


def test_a_source_of_constant_rate_sends_no_times(call: Path) -> None:
    with CallReader(call) as reader:
        controls = [data for data in reader if data[0] // 64 == 2]
    assert [data[1] for data in controls] == [0]
