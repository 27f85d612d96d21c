"""Actuators by the parameters c of a statistical model, from where they are expected."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from aam_faces import synthetic_faces

from aam.model import MultiResolutionModel
from aam.search.landmark_tracker import C_ERROR, ModelExpressionSearch, actuator_sigma
from aam.shape_space import SHAPE_RANGE, actuators
from aam.training.train import TrainingOptions, train
from aam.weak_pose import perspective_pose
from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Picture
from shared_model.geometry import Camera
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters

CAMERA = Camera(200, 180, 2000.0)
SHIFT = np.array([52.0, 46.0])


@pytest.fixture(scope="module")
def model() -> MultiResolutionModel:
    options = TrainingOptions(size=64, retained=0.97, normalisation="none", mirror=False)
    return train(synthetic_faces(10, 2), options)


def film() -> tuple[Picture, ExpectedFace]:
    """A face of the training set in a larger picture, and where it is."""
    face = synthetic_faces(10, 2)[3]
    sides = (int(SHIFT[1]), 38, int(SHIFT[0]), 52)
    picture = cv2.copyMakeBorder(face.window.picture, *sides, cv2.BORDER_REPLICATE)
    pose = face.pose + np.array([0, 0, 0, *SHIFT, 0])
    aau, eau = actuators(face.shape)
    parameters = FaceParameters(perspective_pose(pose, CAMERA), eau)
    expected = ExpectedFace(np.full((468, 3), np.nan), CAMERA, parameters, aau)
    return np.asarray(picture, np.uint8), expected


def test_actuators_are_found_from_others_nearby(model: MultiResolutionModel) -> None:
    picture, expected = film()
    true = expected.face.eau
    off = true.copy()
    off[EAU_INDEX["jaw_drop"]] = np.clip(off[EAU_INDEX["jaw_drop"]] + 0.3, 0, 1)
    start = replace(expected, face=replace(expected.face, eau=off))
    found = ModelExpressionSearch(model).search(picture, start)
    assert found is not None
    jaw = EAU_INDEX["jaw_drop"]
    assert abs(found.eau[jaw] - true[jaw]) < 0.5 * abs(off[jaw] - true[jaw])
    assert np.isfinite(found.points_px[:, :2]).any()


def test_noise_is_no_face(model: MultiResolutionModel) -> None:
    _, expected = film()
    noise = np.random.default_rng(3).integers(0, 255, (180, 200, 3)).astype(np.uint8)
    assert ModelExpressionSearch(model).search(noise, expected) is None


def test_deviations_of_actuators_are_those_of_c(model: MultiResolutionModel) -> None:
    level = model.levels[-1]
    random = np.random.default_rng(5).normal(size=(4000, len(level.deviations)))
    shapes = level.shape_of(C_ERROR * level.deviations * random)
    drawn = shapes.std(0)[-len(EAUS) :] * SHAPE_RANGE[-len(EAUS) :]
    sigma = actuator_sigma(level)
    moving = np.isfinite(sigma)
    assert moving.any() and not moving.all()
    np.testing.assert_allclose(drawn[moving], sigma[moving], rtol=0.1)
    assert drawn[~moving].max() < 1e-5
