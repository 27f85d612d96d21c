"""Recorded frames come with the ones after them; nobody waits for those of a live source."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from encoder.calls.session_stats import Tally
from encoder.capture.video_source import Capture, open_source
from encoder.pipeline import EncodeOptions, with_coming


@pytest.fixture
def capture(tmp_path: Path) -> Iterator[Capture]:
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((8, 8, 3), 10 * number, np.uint8))
    with open_source(str(tmp_path / "%d.png")) as capture:
        yield capture


def shades(
    capture: Capture, options: EncodeOptions, stop_after: int = 99
) -> list[tuple[int, int, int | None]]:
    """Index and shade of each frame, and the shade of the one that comes with it."""
    tally = Tally()
    frames = with_coming(capture, options, tally, lambda: len(tally.capture_ns) >= stop_after)
    return [
        (index, int(frame[0, 0, 0]), None if coming is None else int(coming[0, 0, 0]))
        for index, frame, coming in frames
    ]


def test_recorded_frames_come_with_the_next(capture: Capture) -> None:
    assert shades(capture, EncodeOptions("x")) == [
        (0, 0, 10),
        (1, 10, 20),
        (2, 20, 30),
        (3, 30, None),
    ]


def test_what_was_read_before_a_stop_is_encoded(capture: Capture) -> None:
    assert shades(capture, EncodeOptions("x"), 2) == [(0, 0, 10), (1, 10, None)]


def test_paced_frames_come_alone(capture: Capture) -> None:
    options = EncodeOptions("x", pace=True, max_frames=2)
    assert shades(capture, options) == [(0, 0, None), (1, 10, None)]
