"""How a call's picture fares by minutes."""

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from benchmarks.long_run import face_psnr_db, main, summary_lines
from decoder.sinks.frame_sink import open_sink
from shared_model.errors import UserError

# Two frames a second, for a moment without a face.
CALL = [20.0] * 10 + [math.nan] * 10 + [30.0] * 100 + [32.0] * 120


def test_minutes_and_what_is_after_the_beginning() -> None:
    assert summary_lines(CALL, 2, after_s=10) == [
        "minute 1: 29.09 dB over 110 frames",
        "minute 2: 32.00 dB over 120 frames",
        "after 10 s: 31.09 dB over 220 frames",
        "last minute against the first: +2.91 dB",
    ]


def test_minutes_that_are_the_same_are_not_compared() -> None:
    assert summary_lines(CALL[:-1], 2) == [
        "minute 1: 29.09 dB over 110 frames",
        "minute 2: 32.00 dB over 119 frames",
    ]


def test_a_call_that_ends_before_has_nothing_after() -> None:
    assert summary_lines([25.0] * 4, 2, after_s=5)[1] == "after 5 s: nan dB over 0 frames"


@pytest.mark.parametrize("after", ["-1", "nan"])
def test_seconds_that_are_none(after: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["a.mp4", "b.mkv", f"--after={after}"])
    assert f"{after} is not" in capsys.readouterr().err


def test_a_video_that_ends_before_the_other_is_named(networks: Path, tmp_path: Path) -> None:
    whole, short = tmp_path / "whole.mkv", tmp_path / "short.mkv"
    for path, frames in ((whole, 3), (short, 2)):
        with open_sink(path, 64, 48, Fraction(25)) as sink:
            for _ in range(frames):
                sink.write(np.full((48, 64, 3), 90, np.uint8))
    for source, decoded in ((whole, short), (short, whole)):
        with pytest.raises(UserError, match=r"short\.mkv ends after 2 frames"):
            face_psnr_db(str(source), str(decoded))
