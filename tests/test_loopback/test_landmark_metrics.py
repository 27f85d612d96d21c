"""Likeness of two faces: landmarks apart, gestures together, faces lost."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from loopback.quality.landmark_metrics import (
    LandmarkMetrics,
    compare_faces,
    correlation,
    landmark_metrics,
)
from shared_model.errors import UserError

EYES_PX = 60.0


def talking(count: int = 30) -> NDArray[np.float64]:
    """(t, 468, 2) landmarks of a face whose mouth opens and closes."""
    points = np.tile(np.random.default_rng(1).uniform(0, 200, (468, 2)), (count, 1, 1))
    points[:, 33], points[:, 263] = (50, 50), (50 + EYES_PX, 50)
    points[:, 13] = (80, 100)
    points[:, 14] = np.stack([np.full(count, 80), 100 + 5 * np.sin(np.arange(count)) ** 2], 1)
    return points


def test_a_face_is_like_itself() -> None:
    assert landmark_metrics(talking(), talking()) == LandmarkMetrics(1.0, 0.0, 1.0, None, None)


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


def test_a_clip_is_like_itself(carphone: Path) -> None:
    found = compare_faces(str(carphone), str(carphone), 10)
    assert found.face_found == 1 and found.nme_percent == 0 and found.mouth_corr == 1


def test_nothing_is_said_without_the_landmark_networks(
    noise: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        """No package of networks."""

    monkeypatch.setattr("encoder.detection.tflite.find_spec", missing)
    assert compare_faces(str(noise), str(noise)) == LandmarkMetrics()


def test_a_missing_video_is_the_users_mistake(networks: Path) -> None:
    with pytest.raises(UserError):
        compare_faces("none.mp4", "none.mp4")
