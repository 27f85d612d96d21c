"""Likeness of two faces: landmarks apart, gestures together, faces lost."""

import numpy as np
import pytest

from encoder.detection.landmark_indices import LANDMARK_DISTANCES
from loopback.quality.landmark_metrics import (
    LandmarkMetrics,
    correlation,
    frames_of_blinks,
    landmark_metrics,
    restlessness,
)
from shared_model.arrays import Array

EYES_PX = 60.0


def talking(count: int = 30) -> Array:
    """(t, 468, 2) landmarks of a face whose mouth opens and closes."""
    points = np.tile(np.random.default_rng(1).uniform(0, 200, (468, 2)), (count, 1, 1))
    points[:, 33], points[:, 263] = (50, 50), (50 + EYES_PX, 50)
    points[:, 13] = (80, 100)
    points[:, 14] = np.stack([np.full(count, 80), 100 + 5 * np.sin(np.arange(count)) ** 2], 1)
    return points


def test_a_face_is_like_itself() -> None:
    itself = LandmarkMetrics(1.0, 0.0, 1.0, mouth_mae_percent=0.0, jitter_ratio=1.0)
    assert landmark_metrics(talking(), talking()) == itself


def test_landmarks_apart_are_measured_by_the_eyes_distance() -> None:
    shifted = talking() + np.array([0.6, 0.8])
    found = landmark_metrics(talking(), shifted)
    assert found.nme_percent == pytest.approx(100 / EYES_PX, abs=0.01)
    assert found.mouth_corr == 1.0


def test_a_mouth_that_moves_otherwise_correlates_less() -> None:
    other = talking()
    other[:, 14, 1] = 205 - other[:, 14, 1]
    found = landmark_metrics(talking(), other)
    assert found.mouth_corr is not None and found.mouth_corr < 0


def test_faces_that_are_lost_are_counted_and_left_out() -> None:
    source, decoded = talking(), talking()
    source[:6], decoded[:12] = np.nan, np.nan
    assert landmark_metrics(source, decoded).face_found == 0.75
    assert landmark_metrics(source, decoded).nme_percent == 0
    assert landmark_metrics(source, np.full_like(source, np.nan)) == LandmarkMetrics(face_found=0.0)
    assert landmark_metrics(np.full_like(source, np.nan), source) == LandmarkMetrics()


def test_what_stands_still_has_no_correlation() -> None:
    moving = np.arange(9.0)
    assert correlation(moving, np.ones(9)) is None and correlation(moving[:2], moving[:2]) is None
    assert correlation(moving, 1 - moving) == -1


def test_the_pose_is_compared_by_the_shape_of_the_face() -> None:
    rng = np.random.default_rng(3)
    head = rng.normal(size=(468, 3)) * 60
    head[33], head[263] = (-40, -30, 0), (40, -30, 0)

    def seen(yaw_deg: float) -> Array:
        c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
        turned = head @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        depth = 1500 + turned[:, 2:]
        flat = 640 * turned[:, :2] / depth + [320, 240]
        return np.concatenate([flat, turned[:, 2:] * 640 / 1500], 1)

    angles = np.linspace(-20, 20, 9)
    source = np.array([seen(angle) for angle in angles])
    decoded = np.array([seen(angle + 3) for angle in angles])
    found = landmark_metrics(source, decoded, (640, 480))
    assert found.yaw_mae_deg == pytest.approx(3, abs=0.5)
    assert found.pitch_mae_deg is not None and found.pitch_mae_deg < 0.5
    assert landmark_metrics(source, source, (640, 480)).yaw_mae_deg == 0
    assert landmark_metrics(source[..., :2], decoded[..., :2]).yaw_mae_deg is None


def test_restlessness_is_that_of_the_second_differences() -> None:
    calm = talking()
    restless = calm + np.where(np.arange(len(calm)) % 2, 0.3, -0.3)[:, None, None]
    ratio = landmark_metrics(calm, restless).jitter_ratio
    assert ratio is not None and ratio > 1.5
    still = np.repeat(calm[:1], 9, 0)
    assert restlessness(still) == 0 and restlessness(still + np.arange(9)[:, None, None]) < 1e-9


def test_blinks_are_where_lids_close_and_open() -> None:
    opening = np.array([10, 10, 10, 7, 3, 3, 3, 7, 10, 10, 9.5, 10, np.nan, 10])
    points = np.tile(talking(1), (len(opening), 1, 1))
    for upper, lower in LANDMARK_DISTANCES["blink"]:
        points[:, lower] = (80, 60)
        points[:, upper] = np.stack([np.full(len(opening), 80), 60 - opening], 1)
    assert np.flatnonzero(frames_of_blinks(points)).tolist() == [2, 3, 4, 5, 6, 7, 8]
    assert not frames_of_blinks(np.full((3, 468, 3), np.nan)).any()
