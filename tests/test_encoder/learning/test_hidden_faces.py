"""Faces that hands hide: which frames are searched, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.capture.face_crop import crop_face
from encoder.detection.tflite import find_hand_networks
from encoder.learning.face_sample import FaceSample
from encoder.learning.hidden_faces import (
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


def test_without_the_networks_there_are_no_hands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("encoder.learning.hidden_faces.find_hand_networks", lambda: None)
    watch = HandWatch()
    assert watch.find_all([PICTURE] * 3, [POINTS] * 3) == [[], [], []]
    sample = FaceSample(
        crop_face(PICTURE, FACE / 9, 1.0), FACE / 9, window=window_of(PICTURE, FACE / 9)
    )
    assert watch.hide_in_burst([sample] * 2)[1].crop.hidden is None


def test_a_burst_of_a_live_call_is_searched_by_its_ends(
    watch: HandWatch, clip_frames: ClipFrames
) -> None:
    frames = clip_frames("gesture_eat.mkv", 25)
    samples = [
        FaceSample(
            crop_face(frames[number], FACE, 1.0), FACE, window=window_of(frames[number], FACE)
        )
        for number in (0, 20, 24)
    ]
    seen, *hidden = watch.hide_in_burst(samples)
    assert seen.crop.hidden is None
    for each in hidden:
        crop = each.crop
        assert each.window is None and crop.hidden is not None
        # The chin is, the brow is not.
        places = np.array([(305.0, 185.0), (300, 110)], np.float32)
        assert crop.shows(crop.to_crop_px(places)).tolist() == [False, True]
    assert watch.hide_in_burst([samples[0]] * 2) == [samples[0]] * 2
    assert watch.hide_in_burst([]) == []
    whole = watch.find(frames[24], FACE)[0]
    without = watch.hide_in_burst([replace(samples[2], window=None)])
    assert without[0].crop.hidden is None and whole.shape[1] == 2
