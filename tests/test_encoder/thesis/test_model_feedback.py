"""The feedback of a statistical model: actuators as the filter's measurements (thesis 5.2)."""

from dataclasses import replace

import numpy as np
import pytest

from encoder.fitting.expression_search import FoundExpression
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.landmark_fit import landmark_model
from encoder.fitting.landmark_source import ExpectedFace
from encoder.thesis.measurement_fusion import MeasurementFusion
from encoder.thesis.model_feedback import MEASURED_EAUS, ModelFeedback
from shared_model.animate import Face, identity_from_controls
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, euler_deg, pixel_from_head, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters
from shared_model.shape_residual import residual_basis

HEAD, CAMERA = generic_head(), Camera(256, 224, 360.0)
CONTROL = np.zeros((len(residual_basis(HEAD)), 3))
IDENTITY = identity_from_controls(HEAD, np.zeros(len(AAUS)), CONTROL)
NOTHING = np.zeros((2, 2, 3), np.uint8)


def face_at(yaw_deg: float, **eau: float) -> FaceParameters:
    values = np.zeros(len(EAUS))
    for name, value in eau.items():
        values[EAU_INDEX[name]] = value
    return FaceParameters(pose_from_euler(0, yaw_deg, 0, np.array([0.0, 0, 520])), values)


class BiasedSearch:
    """An `ExpressionSearch` that sees `face`, whose expression is for it `bias` further."""

    sigma_ratio = 3.0

    def __init__(self, face: FaceParameters, bias: Array, sigma: float = 0.01) -> None:
        self.face: FaceParameters | None = face
        self._bias, self._sigma = bias, np.full(len(EAUS), sigma)
        self.expected: list[ExpectedFace] = []

    def search(self, frame: Picture, expected: ExpectedFace) -> FoundExpression | None:
        self.expected.append(expected)
        if self.face is None:
            return None
        model, points = landmark_model(HEAD), np.full((468, 3), np.nan)
        animated = Face(HEAD, IDENTITY).animate(self.face.eau)
        corners = HEAD.triangles[HEAD.network_triangles[model.index]]
        weights = HEAD.network_weights[model.index]
        at = np.einsum("mc,mcd->md", weights, animated[corners])
        points[model.index, :2] = pixel_from_head(CAMERA, self.face.pose, at)
        points[model.index, 2] = 0
        return FoundExpression(self.face.eau + self._bias, self._sigma, points)


def started(search: BiasedSearch, first: FaceParameters) -> ModelFeedback:
    feedback = ModelFeedback(HEAD, search)
    feedback.start(NOTHING, IdentityFit(CAMERA, IDENTITY, CONTROL, (first,)))
    return feedback


def test_what_the_model_makes_of_the_first_face_is_taken_from_what_it_measures() -> None:
    first = face_at(0, mouth_corners=0.1)
    bias = np.zeros(len(EAUS))
    bias[EAU_INDEX["jaw_drop"]] = 0.3
    search = BiasedSearch(first, bias)
    feedback = started(search, first)
    search.face = true = face_at(5, jaw_drop=0.4, mouth_corners=-0.2)
    found = feedback.measure(NOTHING, face_at(2, jaw_drop=0.3))
    assert found is not None
    measured = list(MEASURED_EAUS)
    np.testing.assert_allclose(found.face.eau[measured], true.eau[measured], atol=1e-9)
    assert euler_deg(found.face.pose)[1] == pytest.approx(5, abs=0.1)
    # The search starts at what the filter's face looks like to the model.
    assert search.expected[-1].face.eau[EAU_INDEX["jaw_drop"]] == pytest.approx(0.6)
    others = np.isinf(found.eau_sigma)
    assert sorted(np.flatnonzero(~others)) == sorted(measured)


def test_the_filter_follows_the_actuators_that_the_model_measures() -> None:
    first = face_at(0)
    search = BiasedSearch(first, np.zeros(len(EAUS)))
    feedback, face = started(search, first), Face(HEAD, IDENTITY)
    search.face = true = face_at(3, jaw_drop=0.3)
    skin = np.flatnonzero((HEAD.parts == 0) & (HEAD.opacity > 0.9))
    points = skin[::97][:20].astype(np.int32)
    fusion = MeasurementFusion(CAMERA, face, first, MEASURED_EAUS, 0, 0, points)
    predicted = fusion.predict(first, 0.04)
    found = feedback.measure(NOTHING, predicted)
    assert found is not None
    after = fusion.update(predicted, fed_back=found)
    jaw = EAU_INDEX["jaw_drop"]
    assert after.eau[jaw] == pytest.approx(true.eau[jaw], abs=0.03)
    assert euler_deg(after.pose)[1] == pytest.approx(3, abs=0.5)
    # A model that is less sure is followed less.
    doubted = MeasurementFusion(CAMERA, face, first, MEASURED_EAUS, 0, 0, points)
    predicted = doubted.predict(first, 0.04)
    unsure = replace(found, eau_sigma=100 * found.eau_sigma)
    assert doubted.update(predicted, fed_back=unsure).eau[jaw] < 0.5 * after.eau[jaw]


def test_a_face_that_the_model_does_not_find_is_not_measured() -> None:
    search = BiasedSearch(face_at(0), np.zeros(len(EAUS)))
    feedback = started(search, face_at(0))
    search.face = None
    assert feedback.measure(NOTHING, face_at(0)) is None
    with pytest.raises(ValueError, match="expected start before measure"):
        ModelFeedback(HEAD, search).measure(NOTHING, face_at(0))
