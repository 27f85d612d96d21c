"""Faces that hands hide: which frames are searched, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.capture.face_crop import crop_face
from encoder.detection.tflite import find_hand_networks
from encoder.learning.face_sample import FaceSample
from encoder.learning.hidden_faces import (
    HandSuspicion,
    HandWatch,
    SampleHands,
    that_come_and_go,
    window_of,
    without_hands,
)
from shared_model.arrays import Array, Picture

HAND = np.array([(0.0, 0.0), (9, 0), (9, 9)])
PICTURE, POINTS = np.zeros((40, 40, 3), np.uint8), np.zeros((468, 3))
# Landmarks of the face of gesture_eat, roughly, pixels.
FACE = np.tile([(258.0, 95.0, 0.0), (342, 195, 0)], (234, 1))


class Counting(HandWatch):
    """Finds a hand in each frame, and counts them."""

    def __init__(self) -> None:
        super().__init__()
        self.searched = 0

    def find(self, picture: Picture, points: Array) -> list[Array]:
        self.searched += 1
        return [HAND]


@pytest.fixture(scope="module")
def watch() -> HandWatch:
    if find_hand_networks() is None:
        pytest.skip("needs the hand networks of mediapipe")
    return HandWatch()


def test_hands_that_are_nearly_always_there_belong_to_the_person() -> None:
    leant = [[HAND]] * 19 + [[]]
    assert that_come_and_go(leant) == [[]] * 20
    assert that_come_and_go([*leant[1:], [], []]) == [*leant[1:], [], []]
    assert that_come_and_go([]) == []
    assert without_hands([[], [HAND], []]) == [0, 2]


def test_frames_are_searched_only_beside_those_of_the_sample_that_show_a_hand() -> None:
    watch = Counting()
    sample = SampleHands(watch, [0, 4, 8, 12], [[], [], [HAND], []])
    found = [bool(sample.in_frame(number, PICTURE, POINTS)) for number in range(16)]
    assert found == [False] * 5 + [True] * 7 + [False] * 4
    # That of the sample is known.
    assert watch.searched == 6


def test_every_second_frame_of_a_series_is_searched_and_those_beside_a_hand() -> None:
    class InOne(Counting):
        def find(self, picture: Picture, points: Array) -> list[Array]:
            return super().find(picture, points) if points[0, 0] == 4 else []

    watch, points = InOne(), [np.full((468, 3), float(number)) for number in range(8)]
    found, known = watch.find_in_series([PICTURE] * 8, points, {})
    assert [bool(each) for each in found] == [False] * 4 + [True] + [False] * 3
    assert sorted(known) == sorted(points[each].tobytes() for each in (0, 2, 3, 4, 5, 6))
    # What is known is not searched again, and what is gone is forgotten.
    again, still = watch.find_in_series([PICTURE] * 3, points[3:6], known)
    assert [bool(each) for each in again] == [False, True, False] and watch.searched == 1
    assert len(still) == 3


def test_without_the_networks_there_are_no_hands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("encoder.learning.hidden_faces.find_hand_networks", lambda: None)
    watch = HandWatch()
    assert watch.find_all([PICTURE] * 3, [POINTS] * 3) == [[], [], []]
    sample = FaceSample(
        crop_face(PICTURE, FACE / 9, 1.0), FACE / 9, window=window_of(PICTURE, FACE / 9)
    )
    assert watch.hide(sample) is sample


def test_hands_are_hidden_in_a_sample_of_a_live_call(
    watch: HandWatch, clip_frames: ClipFrames
) -> None:
    frames = clip_frames("gesture_eat.mkv", 25)
    seen, *others = (
        FaceSample(
            crop_face(frames[number], FACE, 1.0), FACE, window=window_of(frames[number], FACE)
        )
        for number in (0, 20, 24)
    )
    assert watch.hide(seen) is seen
    for each in others:
        hidden = watch.hide(each)
        assert hidden.window is None and hidden.crop.hidden is not None
        # The chin is, the brow is not.
        places = np.array([(305.0, 185.0), (300, 110)], np.float32)
        assert hidden.crop.shows(hidden.crop.to_crop_px(places)).tolist() == [False, True]
    without = replace(others[1], window=None)
    assert watch.hide(without) is without


def test_samples_are_searched_now_and_then_and_where_something_is_odd() -> None:
    suspicion = HandSuspicion(samples_per_s=4)

    def searched(energies: list[float], has_hands: bool = False) -> list[bool]:
        done = []
        for energy in energies:
            done.append(suspicion.is_due(energy))
            if done[-1]:
                suspicion.note(has_hands)
        return done

    assert searched([1.0] * 9) == [True, False, False, False] * 2 + [True]
    assert searched([1.0, 1.4, 2.2, 1.0]) == [False, False, True, False]
    assert searched([1.0] * 3, has_hands=True) == [False, False, True]
    # What follows upon a hand is, and a hand is never usual.
    assert searched([2.0] * 12, has_hands=True) == [True] * 12
    assert searched([1.0] * 2) == [True, False]
