"""Weak perspective: projections agree with the perspective camera's; steps are in head axes."""

import numpy as np
import pytest
from aam_faces import HEAD, POSE

from aam.weak_pose import (
    displaced,
    euler_angles_deg,
    pose_vector,
    project,
    step_between,
    telephoto,
)
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler


def test_a_telephoto_camera_projects_as_weak_perspective_does() -> None:
    camera, pose = telephoto(POSE, (220, 200))
    expected = project(POSE, HEAD.vertices)
    np.testing.assert_allclose(pixel_from_head(camera, pose, HEAD.vertices), expected, atol=0.1)


def test_a_perspective_pose_keeps_its_angles_and_the_pixel_of_the_origin() -> None:
    camera = Camera(640, 480, 800.0)
    pose = pose_from_euler(10, -20, 5, np.array([30.0, -20.0, 600.0]))
    vector = pose_vector(pose, camera)
    assert euler_angles_deg(vector) == pytest.approx((10, -20, 5))
    origin = pixel_from_head(camera, pose, np.zeros((1, 3)))
    np.testing.assert_allclose(project(vector, np.zeros((1, 3))), origin)


def test_a_step_back_undoes_a_step_of_rotation() -> None:
    step = np.array([0.1, -0.2, 0.15, 0, 0, 0])
    np.testing.assert_allclose(displaced(displaced(POSE, step), -step), POSE, atol=1e-12)


def test_a_shift_goes_along_the_heads_horizontal_axis_in_the_picture() -> None:
    rolled = np.array([0, 0, np.radians(30), 50.0, 50.0, np.log(2.0)])
    moved = displaced(rolled, np.array([0, 0, 0, 10.0, 0, 0]))
    along = project(rolled, np.array([[1.0, 0, 0], [0, 0, 0]]))
    direction = (along[0] - along[1]) / np.linalg.norm(along[0] - along[1])
    np.testing.assert_allclose(moved[3:5] - rolled[3:5], 20 * direction, atol=1e-9)


def test_the_step_between_two_poses_leads_from_one_to_the_other() -> None:
    target = POSE + np.array([0.2, -0.1, 0.3, 5.0, -7.0, 0.1])
    np.testing.assert_allclose(displaced(POSE, step_between(POSE, target)), target, atol=1e-12)
