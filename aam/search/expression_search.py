"""Pose and c of one face in a video, from where the tracker's filter has it (thesis 4.4, 5.2)."""

import numpy as np

from aam.model import AppearanceModel, MultiResolutionModel
from aam.search.face_finder import on_network_landmarks
from aam.search.find_face import find_near, is_explained
from aam.search.landmark_tracker import SIGMA_RATIO
from aam.shape_space import SHAPE_RANGE, actuators, shape_vector
from aam.weak_pose import pose_vector_at
from encoder.fitting.expression_search import FoundExpression
from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Array, Picture
from shared_model.parameters import EAUS

# Error of a found c, in its standard deviations: what Table 2.6 has for one prediction, about.
C_ERROR = 0.25
# An actuator of less deviation does not move in the model.
STILL = 1e-6


class ModelExpressionSearch:
    """An `ExpressionSearch` by a model that `risorius train` made.

    first_level: levels before it are left out of each search.
    """

    sigma_ratio = SIGMA_RATIO

    def __init__(self, model: MultiResolutionModel, first_level: int = 0) -> None:
        self._model, self._first_level = model, first_level
        self._sigma = actuator_sigma(model.levels[-1])

    def search(self, frame: Picture, expected: ExpectedFace) -> FoundExpression | None:
        """See `ExpressionSearch`."""
        pose = pose_vector_at(expected.face.pose, expected.camera)
        shape = shape_vector(expected.aau, expected.face.eau)
        fit = find_near(self._model, frame, pose, shape, self._first_level)
        if not is_explained(self._model, fit):
            return None
        _, eau = actuators(fit.shape)
        return FoundExpression(eau, self._sigma, on_network_landmarks(self._model, fit))


def actuator_sigma(model: AppearanceModel) -> Array:
    """(EAUs,) standard deviations of actuators whose c have errors of `C_ERROR` (eq. 2.19);
    infinite where they do not move."""
    steps = model.shape_of(np.diag(C_ERROR * model.deviations)) - model.shape.mean
    sigma = np.sqrt((steps**2).sum(0))[-len(EAUS) :] * SHAPE_RANGE[-len(EAUS) :]
    return np.asarray(np.where(sigma > STILL, sigma, np.inf))
