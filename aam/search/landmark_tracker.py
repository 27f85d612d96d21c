"""Landmarks, and actuators, of one face in a video, by a trained model and no network.

The model is searched from where the face is expected (the tracker's prediction: pose and
actuators), and for landmarks, where nobody says, or where it is not found there, in the whole
picture.  Actuators are those of its parameters c (thesis 4.4, 5.2).
"""

from pathlib import Path

import numpy as np

from aam.model import AppearanceModel, MultiResolutionModel
from aam.search.face_finder import FaceFinder, on_network_landmarks
from aam.search.find_face import FaceFit, find_near, is_explained
from aam.shape_space import SHAPE_RANGE, actuators, shape_vector
from aam.weak_pose import pose_vector_at
from encoder.detection.landmarks import Landmarks
from encoder.fitting.expression_search import FoundExpression
from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Array, Picture
from shared_model.parameters import EAUS

# Standard deviation of the landmarks in terms of those of the network: of first frames of nine
# clips, the shapes that are fitted with it come nearest to those of the network.
SIGMA_RATIO = 3.0
# Error of a found c, in its standard deviations: what Table 2.6 has for one prediction, about.
C_ERROR = 0.25
# An actuator of less deviation does not move in the model.
STILL = 1e-6


class ModelLandmarkTracker:
    """A `LandmarkSource` by a model that `risorius train` made.

    nose: see `FaceFinder`.  every_frame, sigma_ratio: see `LandmarkSource`.
    """

    def __init__(
        self,
        model: MultiResolutionModel,
        nose: Path | None = None,
        every_frame: bool = True,
        sigma_ratio: float = SIGMA_RATIO,
    ) -> None:
        self._model, self._finder = model, FaceFinder(model, nose)
        self.every_frame, self.sigma_ratio = every_frame, sigma_ratio
        # Pose (6,) and shape (25,) from which the next picture is searched.
        self._start: tuple[Array, Array] | None = None

    @property
    def face_count(self) -> int:
        """See `LandmarkSource`."""
        return self._finder.face_count

    def expect(self, face: ExpectedFace | None) -> None:
        """See `LandmarkSource`."""
        self._start = None
        if face is not None:
            pose = pose_vector_at(face.face.pose, face.camera)
            self._start = pose, shape_vector(face.aau, face.face.eau)

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        """See `LandmarkSource`; the score is the share of the texture that is explained."""
        fit = self._near(frame) or self._finder.find(frame)
        self._start = None if fit is None else (fit.pose, fit.shape)
        if fit is None:
            return None
        share = float(np.clip(1 - fit.error, 0, 1))
        return Landmarks(on_network_landmarks(self._model, fit), share)

    def _near(self, frame: Picture) -> FaceFit | None:
        if self._start is None:
            return None
        fit = find_near(self._model, frame, *self._start)
        return fit if is_explained(self._model, fit) else None


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
