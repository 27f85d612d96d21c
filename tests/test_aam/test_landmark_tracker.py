"""Landmarks by a statistical model in a video: where a face is expected, and where none is."""

import cv2
import numpy as np
import pytest
from aam_faces import synthetic_faces

from aam.model import MultiResolutionModel
from aam.search.landmark_tracker import ModelLandmarkTracker
from aam.shape_space import actuators
from aam.training.train import TrainingOptions, train
from aam.warps import head_warp
from aam.weak_pose import perspective_pose, pose_vector_at, project
from encoder.fitting.landmark_fit import landmark_model
from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

CAMERA = Camera(200, 180, 2000.0)
SHIFT = np.array([52.0, 46.0])


@pytest.fixture(scope="module")
def model() -> MultiResolutionModel:
    options = TrainingOptions(size=64, retained=0.97, normalisation="none", mirror=False)
    return train(synthetic_faces(10, 2), options)


def film() -> tuple[Picture, ExpectedFace, Array]:
    """A stranger's picture, where they are, and their true landmarks (m, 2)."""
    face, warp = synthetic_faces(11, 1)[10], head_warp(64, "full")
    sides = (int(SHIFT[1]), 38, int(SHIFT[0]), 52)
    picture = cv2.copyMakeBorder(face.window.picture, *sides, cv2.BORDER_REPLICATE)
    pose = face.pose + np.array([0, 0, 0, *SHIFT, 0])
    aau, eau = actuators(face.shape)
    parameters = FaceParameters(perspective_pose(pose, CAMERA), eau)
    points = np.full((468, 3), np.nan)
    expected = ExpectedFace(points, CAMERA, parameters, aau)
    return np.asarray(picture, np.uint8), expected, warp.landmarks(face.shape, pose)


def test_a_face_is_found_where_it_is_expected(model: MultiResolutionModel) -> None:
    picture, expected, true = film()
    tracker, index = ModelLandmarkTracker(model), head_warp(64, "full").landmark_index
    tracker.expect(expected)
    found = tracker.update(picture)
    assert found is not None and 0.5 < found.score <= 1
    eyes = np.linalg.norm(true[0] - true[-1])
    assert np.linalg.norm(found.points[index, :2] - true, axis=1).mean() < 0.08 * eyes
    # The tip of the nose is nearer than the outer corners of the eyes.
    assert found.points[4, 2] < found.points[[33, 263], 2].min()
    # The next picture is searched from there, without being told.
    again = tracker.update(np.roll(picture, 2, axis=1))
    assert again is not None
    moved = again.points[index, :2] - found.points[index, :2]
    np.testing.assert_allclose(moved.mean(0), [2, 0], atol=1.0)


def test_without_a_face_there_are_no_landmarks(model: MultiResolutionModel) -> None:
    _, expected, _ = film()
    noise = np.random.default_rng(3).integers(0, 255, (180, 200, 3)).astype(np.uint8)
    tracker = ModelLandmarkTracker(model)
    assert tracker.update(noise) is None
    tracker.expect(expected)
    assert tracker.update(noise) is None


def test_weak_perspective_about_the_face_shows_it_as_the_camera_does() -> None:
    points = landmark_model(generic_head()).neutral
    camera = Camera(640, 480, 800.0)
    pose = pose_from_euler(8, -20, 5, np.array([60.0, -40, 700]))
    seen = pixel_from_head(camera, pose, points)
    weak = project(pose_vector_at(pose, camera), points)
    width = np.ptp(seen[:, 0])
    assert np.linalg.norm(weak - seen, axis=1).mean() < 0.02 * width
