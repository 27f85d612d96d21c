"""Recorded frames come with the ones after them; nobody waits for those of a live source."""

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from encoder.calls.frame_source import FrameSource
from encoder.calls.session_stats import SessionStats
from encoder.calls.waiting_frames import FrameDelay, SeenFrame
from encoder.capture.video_source import Capture, open_source


@pytest.fixture
def capture(tmp_path: Path) -> Iterator[Capture]:
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((8, 8, 3), 10 * number, np.uint8))
    with open_source(str(tmp_path / "%d.png")) as capture:
        yield capture


def shades(
    capture: Capture, stop_after: int = 99, pace: bool = False, max_frames: int | None = None
) -> list[tuple[int, int, int | None]]:
    """Index and shade of each frame, and the shade of the one that comes with it."""
    stats = SessionStats()
    source = FrameSource(capture, stats, lambda: stats.captured >= stop_after, max_frames, pace)
    return [
        (index, int(picture[0, 0, 0]), None if following is None else int(following[0, 0, 0]))
        for index, picture, following in source.with_lookahead()
    ]


def test_recorded_frames_come_with_the_next(capture: Capture) -> None:
    assert shades(capture) == [(0, 0, 10), (1, 10, 20), (2, 20, 30), (3, 30, None)]


def test_what_was_read_before_a_stop_is_encoded(capture: Capture) -> None:
    assert shades(capture, stop_after=2) == [(0, 0, 10), (1, 10, None)]


def test_paced_frames_come_alone(capture: Capture) -> None:
    assert shades(capture, pace=True, max_frames=2) == [(0, 0, None), (1, 10, None)]


def test_a_paced_source_notes_how_late_its_frames_are_taken(capture: Capture) -> None:
    stats, held_s = SessionStats(), 5 / float(capture.fps)
    frames = FrameSource(capture, stats, lambda: False, pace=True).frames()
    next(frames)
    taken_s = time.monotonic()
    while time.monotonic() < taken_s + held_s:
        pass
    next(frames)
    assert stats.worst_lag_s >= held_s - 1 / float(capture.fps)


def test_frames_wait_their_time_in_the_time_of_the_source() -> None:
    delay, nothing = FrameDelay(0.5, fps=4), np.zeros((0, 0, 3), np.uint8)
    due = []
    for index in (0, 1, 3, 4):
        points = np.zeros((468, 3)) if index == 3 else None
        delay.add(SeenFrame(index, nothing, points, seen_s=0.0))
        due.append([frame.index for frame in delay.due(index)])
    assert due == [[], [], [0, 1], []] and delay.shows_face
    # The clock is past the time of all that wait.
    assert [frame.index for frame in delay.rest(lambda: 0.6)] == [3, 4]
    assert not delay.shows_face and list(delay.rest(None)) == []
    assert delay and not FrameDelay(0, fps=4)
