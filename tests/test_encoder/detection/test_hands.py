"""Hands near a face."""

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.detection.hands import HandFinder, hand_outline, window_around
from encoder.detection.tflite import find_hand_networks
from runtime.parallel import parallel_map

# Where the face of gesture_eat is, pixels.
FACE = np.array([(258.0, 95.0, 0.0), (342, 195, 0)])


@pytest.fixture(scope="module")
def finder() -> HandFinder:
    files = find_hand_networks()
    if files is None:
        pytest.skip("needs the hand networks of mediapipe")
    return HandFinder(files)


def test_a_hand_at_the_mouth_is_found_where_it_is(
    finder: HandFinder, clip_frames: ClipFrames
) -> None:
    frames = clip_frames("gesture_eat.mkv", 25)
    window = window_around(FACE)
    assert not finder.find(frames[0], window)
    (outline,) = finder.find(frames[24], window)
    left, top = outline.min(0)
    assert 270 < left < 300 and 155 < top < 180
    # As several threads find it, each with networks of its own.
    found = parallel_map(lambda frame: finder.find(frame, window), [frames[24]] * 3, 3)
    assert all(np.array_equal(each[0], outline) for each in found)


def test_a_face_alone_has_no_hand(finder: HandFinder, clip_frames: ClipFrames) -> None:
    for frame in clip_frames("smile.mp4", 31)[::10]:
        height, width = frame.shape[:2]
        face = np.array([(0.3 * width, 0.2 * height), (0.7 * width, 0.8 * height)])
        assert not finder.find(frame, window_around(face))


def test_nothing_is_found_in_a_picture_without_anything(finder: HandFinder) -> None:
    grey = np.full((60, 80, 3), 120, np.uint8)
    for window in ((0, 0, 80), (-300, 20, 40), (10, 10, 2)):
        assert not finder.find(grey, window)


def test_the_outline_holds_the_joints_and_reaches_into_the_forearm() -> None:
    joints = np.zeros((21, 2))
    joints[0], joints[9], joints[12] = (50, 100), (50, 60), (50, 20)
    outline = hand_outline(joints)
    assert (outline.min(0) < 0).all()
    assert outline[:, 1].max() > 135


def test_the_window_holds_the_face_and_more_below_it() -> None:
    left, top, side = window_around(FACE)
    low, high = FACE.min(0)[:2], FACE.max(0)[:2]
    assert left < low[0] and left + side > high[0] and top < low[1]
    assert top + side - high[1] > low[1] - top > 0
