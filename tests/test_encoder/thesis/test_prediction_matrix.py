"""Prediction matrices reduce trained displacements, and fits by them converge."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.fitting.increments import apply_increment
from encoder.thesis.prediction_matrix import PredictionMatrixFitter
from runtime.image_ops import sample_bicubic
from shared_model.appearance import atlas_of
from shared_model.geometry import (
    euler_deg,
    matrix_from_quaternion,
    multiply,
    normalise,
    quaternion_from_vector,
)
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters, Pose

MOVED = [EAU_INDEX[name] for name in ("jaw_drop", "mouth_corners", "eyebrow_middle")]
JAW, CORNERS = 6 + EAU_INDEX["jaw_drop"], 6 + EAU_INDEX["mouth_corners"]
NUMBER = 0


def untrained(kind: type[TexelFitter], shots: Shots, number: int = NUMBER) -> TexelFitter:
    """A fitter with a template from one picture."""
    head, face = shots.face.head, shots.faces[number]
    shape = ShapeFreeFrame(shots.face, atlas_of(head, 72), shots.camera)
    worn = (head.opacity[shape.atlas.corners].min(1) > 0.99).astype(np.float32)
    mean = sample_bicubic(luma_f32(shots.pictures[number]), shape.positions(face))[:, 0]
    light = np.stack([mean - mean.mean(), np.ones_like(mean)])
    fitter = kind(shots.face, shape, Template(mean, light, worn))
    seen = fitter.visible(face)
    template = fitter.template
    fitter.template = replace(template, weight=template.weight * seen)
    return fitter


@pytest.fixture(scope="module")
def fitter(shots: Shots) -> PredictionMatrixFitter:
    fitter = untrained(PredictionMatrixFitter, shots)
    assert isinstance(fitter, PredictionMatrixFitter)
    fitter.train(whole(shots.pictures[NUMBER]), shots.faces[NUMBER])
    return fitter


def displaced(face: FaceParameters, index: int, by: float) -> FaceParameters:
    return apply_increment(face, by * np.eye(6 + len(EAUS))[index])


def off(found: FaceParameters, truth: FaceParameters) -> tuple[float, float]:
    """Largest difference of angles, degrees, and of actuators."""
    angles = np.subtract(euler_deg(found.pose), euler_deg(truth.pose))
    return float(np.abs(angles).max()), float(np.abs((found.eau - truth.eau)[MOVED]).max())


@pytest.mark.parametrize(
    ("index", "by"),
    [
        *[(turn, np.radians(degrees)) for turn in range(3) for degrees in (-5.0, 5.0)],
        *[(way, mm) for way in (3, 4) for mm in (-6.0, 6.0)],
        *[(5, mm) for mm in (-25.0, 25.0)],
        *[(JAW, 0.3), (CORNERS, -0.3), (CORNERS, 0.3)],
    ],
)
def test_one_prediction_reduces_a_trained_displacement(
    shots: Shots, fitter: PredictionMatrixFitter, index: int, by: float
) -> None:
    truth = shots.faces[NUMBER]
    start = displaced(truth, index, by)
    found = fitter.fit_crop(whole(shots.pictures[NUMBER]), start, 1, MOVED)
    if index < 3:
        left, was = off(found, truth)[0], off(start, truth)[0]
    elif index < 6:
        ways = [face.pose.translation_mm[index - 3] for face in (found, start)]
        left, was = np.abs(np.array(ways) - truth.pose.translation_mm[index - 3])
    else:
        left, was = off(found, truth)[1], off(start, truth)[1]
    assert left < 0.85 * was


@pytest.mark.parametrize("number", [0, 1])
def test_a_moved_face_is_fitted(shots: Shots, fitter: PredictionMatrixFitter, number: int) -> None:
    truth = shots.faces[number]
    step = np.zeros(6 + len(EAUS))
    step[:5] = [0.05, -0.05, 0.04, 2, -2]
    found = fitter.fit_crop(whole(shots.pictures[number]), apply_increment(truth, step), 8, MOVED)
    angle, eau = off(found, truth)
    assert angle < 1.5 and eau < 0.1


def test_the_coefficient_of_brighter_light_is_recovered(
    shots: Shots, fitter: PredictionMatrixFitter
) -> None:
    truth = shots.faces[NUMBER]
    picture = np.clip(1.25 * shots.pictures[NUMBER].astype(float), 0, 255).astype(np.uint8)
    found = fitter.fit_crop(whole(picture), displaced(truth, 1, np.radians(4)), 8, MOVED)
    assert found.modes[0] == pytest.approx(0.25, abs=0.04)
    assert off(found, truth)[0] < 0.5


@pytest.mark.parametrize("degrees", [-60.0, 45.0])
def test_a_tilted_head_is_fitted_like_an_upright_one(
    shots: Shots, fitter: PredictionMatrixFitter, degrees: float
) -> None:
    turn = quaternion_from_vector(np.array([0, 0, np.radians(degrees)]))
    matrix, centre = matrix_from_quaternion(turn), shots.camera.centre

    def tilted(face: FaceParameters) -> FaceParameters:
        rotation = normalise(multiply(turn, face.pose.rotation))
        return replace(face, pose=Pose(rotation, matrix @ face.pose.translation_mm))

    picture = shots.pictures[NUMBER]
    about = np.c_[matrix[:2, :2], centre - matrix[:2, :2] @ centre]
    size = (shots.camera.width, shots.camera.height)
    turned = np.asarray(cv2.warpAffine(picture, about, size, flags=cv2.INTER_CUBIC), np.uint8)
    start = displaced(shots.faces[NUMBER], 1, np.radians(5))
    upright = tilted(fitter.fit_crop(whole(picture), start, 2, MOVED))
    found = fitter.fit_crop(whole(turned), tilted(start), 2, MOVED)
    assert off(upright, tilted(start))[0] > 1
    assert off(found, upright)[0] < 0.5 and off(found, upright)[1] < 0.03
    assert found.pose.translation_mm[:2] == pytest.approx(upright.pose.translation_mm[:2], abs=0.5)


def test_a_fit_before_training_is_refused(shots: Shots) -> None:
    fresh = untrained(PredictionMatrixFitter, shots)
    with pytest.raises(ValueError, match="no matrix has been trained"):
        fresh.fit_crop(whole(shots.pictures[NUMBER]), shots.faces[NUMBER], 1, MOVED)
