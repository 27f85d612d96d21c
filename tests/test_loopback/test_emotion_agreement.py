"""Emotions of two faces, by landmarks that the head model itself makes."""

import numpy as np
import pytest

from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.fitting.landmark_fit import landmark_model, rotated_points
from loopback.quality.emotion_agreement import REST, emotion_agreement, shown_emotions
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.arrays import Array
from shared_model.geometry import Camera, matrix_from_quaternion, pixel_from_camera, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import EAUS

SIZE = (640, 480)
HAPPINESS, SADNESS = 0, 3


def landmarks(emotions: list[int]) -> Array:
    """(t, 468, 3) of the generic head, from the front: each emotion at its peak, or rest."""
    model = landmark_model(generic_head())
    camera = Camera(*SIZE, 900.0)
    pose = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 700.0]))
    found = np.zeros((len(emotions), LANDMARK_COUNT, 3))
    for number, emotion in enumerate(emotions):
        eau = np.zeros(len(EAUS)) if emotion == REST else EMOTIONS[emotion].peak()
        rotated, _ = rotated_points(model, matrix_from_quaternion(pose.rotation), eau)
        points = rotated + pose.translation_mm
        found[number, model.index, :2] = pixel_from_camera(camera, points)
        found[number, model.index, 2] = points[:, 2] * 900 / 700
    return found


def test_the_strongest_signature_is_what_is_shown() -> None:
    peaks = np.stack([*(0.6 * emotion.peak() for emotion in EMOTIONS), np.zeros(len(EAUS))])
    assert shown_emotions(peaks).tolist() == [*range(len(EMOTIONS)), REST]


def test_frames_of_the_same_emotion_agree_and_others_do_not() -> None:
    source = landmarks([REST, REST, HAPPINESS, SADNESS])
    assert emotion_agreement(source, source, SIZE) == 1
    assert emotion_agreement(source, landmarks([REST, REST, REST, SADNESS]), SIZE) == 0.75


@pytest.mark.parametrize("lost", ["source", "decoded"])
def test_frames_without_a_face_in_both_do_not_count(lost: str) -> None:
    both = {name: landmarks([REST, HAPPINESS]) for name in ("source", "decoded")}
    both[lost][0] = np.nan
    assert emotion_agreement(both["source"], both["decoded"], SIZE) == 1
    both[lost][:] = np.nan
    assert emotion_agreement(both["source"], both["decoded"], SIZE) is None
