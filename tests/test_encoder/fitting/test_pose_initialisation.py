"""Known poses are recovered from three and from many projected points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from encoder.detection.detector import Detection
from encoder.fitting.pose_initialisation import (
    anchor_points,
    pose_from_points,
    pose_from_three_points,
    weak_perspective_pose,
)
from shared_model.geometry import (
    Camera,
    camera_from_head,
    euler_deg,
    pixel_from_head,
    pose_from_euler,
)
from shared_model.mesh import generic_head
from shared_model.parameters import Pose

CAMERA = Camera(640, 480, 700.0)
ANCHORS = np.array([[-31.0, 16, 77], [31, 16, 77], [0, -20, 108]])


def scaled_orthography(pose: Pose, points_mm: np.ndarray) -> np.ndarray:
    """Projection of all points at their mean depth."""
    seen = camera_from_head(pose, points_mm)
    depth = seen[:, 2].mean()
    return np.asarray(CAMERA.focal_px * seen[:, :2] / depth + CAMERA.centre)


@given(
    pitch=st.floats(-25, 25),
    yaw=st.floats(-35, 35),
    roll=st.floats(-40, 40),
    x=st.floats(-150, 150),
    y=st.floats(-100, 100),
    z=st.floats(300, 1500),
)
def test_weak_perspective_pose_is_exact_under_weak_perspective(
    pitch: float, yaw: float, roll: float, x: float, y: float, z: float
) -> None:
    true = pose_from_euler(pitch, yaw, roll, np.array([x, y, z]))
    pixels = scaled_orthography(true, ANCHORS)
    found = weak_perspective_pose(CAMERA, ANCHORS, pixels)
    assert scaled_orthography(found, ANCHORS) == pytest.approx(pixels, abs=1e-4)
    assert euler_deg(found) == pytest.approx((pitch, yaw, roll), abs=0.05)
    assert found.translation_mm == pytest.approx(true.translation_mm, rel=1e-3, abs=0.5)


def test_three_points_of_a_detection_give_a_rough_pose_under_perspective() -> None:
    head = generic_head()
    true = pose_from_euler(5, -15, 10, np.array([40.0, -20, 700]))
    keypoints = np.zeros((6, 2))
    keypoints[:3] = pixel_from_head(CAMERA, true, anchor_points(head))
    found = pose_from_three_points(head, CAMERA, Detection(np.zeros(4), keypoints, 1.0))
    assert euler_deg(found) == pytest.approx(euler_deg(true), abs=8)
    assert found.translation_mm == pytest.approx(true.translation_mm, abs=40)


def test_degenerate_triangles_are_refused() -> None:
    pixels = np.array([[0.0, 0], [10, 0], [5, 8]])
    with pytest.raises(ValueError, match="one line"):
        weak_perspective_pose(CAMERA, np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), pixels)
    with pytest.raises(ValueError, match="same"):
        weak_perspective_pose(CAMERA, ANCHORS, pixels[[0, 0, 1]])
    with pytest.raises(ValueError, match="expected"):
        weak_perspective_pose(CAMERA, ANCHORS[:2], pixels[:2])


@pytest.mark.parametrize("near", [False, True])
def test_pose_from_points_recovers_the_pose(near: bool) -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform([-60, -60, 0], [60, 60, 120], (40, 3))
    true = pose_from_euler(-12, 25, 20, np.array([60.0, 30, 800]))
    start = pose_from_euler(-8, 20, 15, np.array([50.0, 20, 760])) if near else None
    pixels = pixel_from_head(CAMERA, true, points)
    found = pose_from_points(CAMERA, points, pixels, start)
    assert euler_deg(found) == pytest.approx((-12, 25, 20), abs=1e-3)
    assert found.translation_mm == pytest.approx(true.translation_mm, abs=0.01)
    noisy = pose_from_points(CAMERA, points, pixels + rng.normal(0, 0.5, pixels.shape), start)
    assert euler_deg(noisy) == pytest.approx((-12, 25, 20), abs=1.0)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ValueError, match="points_mm"):
        pose_from_points(CAMERA, np.zeros((3, 3)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="pixels"):
        pose_from_points(CAMERA, np.zeros((5, 3)), np.zeros((4, 2)))
