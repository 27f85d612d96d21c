"""Analysis by synthesis with a statistical model, fed back into the filter (thesis 4.4, 5.2).

The filter's actuators become parameters c of the model (eq. 2.18, 2.20), from which it is searched
in the picture.  The c that it finds become actuators again (eq. 2.19), which the filter takes as
measured, with the pose.
"""

from dataclasses import dataclass, replace

import numpy as np

from encoder.fitting.expression_search import ExpressionSearch
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, landmark_model, personalise
from encoder.fitting.landmark_source import ExpectedFace
from encoder.thesis.detection_measurement import ITERATIONS_FROM_PREDICTION, expected_face
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import EAU_INDEX, EAUS, THESIS_EAUS, FaceParameters, clip_eau

# The model's actuators that measure; the thesis' tracking model has no others (4.4).
MEASURED_EAUS = tuple(EAU_INDEX[name] for name in THESIS_EAUS)


@dataclass(frozen=True, slots=True)
class FedBackFace:
    """A face that the model measured.

    face: its pose, and the actuators that were measured.
    eau_sigma: (EAUs,) standard deviations; infinite where not measured.
    sigma_ratio: see `ExpressionSearch`.
    """

    face: FaceParameters
    eau_sigma: Array
    sigma_ratio: float


class ModelFeedback:
    """Measures one person's face by a statistical model in picture after picture.

    A model of many people sees a person's resting face as some expression.  What it makes of the
    first face is therefore taken from all that it measures.
    """

    def __init__(self, head: Head, search: ExpressionSearch) -> None:
        self._search = search
        self._generic = landmark_model(head)
        self._person: _Person | None = None
        self._offset = np.zeros(len(EAUS))

    def start(self, frame: Picture, fitted: IdentityFit) -> None:
        """Begin with a person's first face, `fitted.frames[0]`, and the picture that shows it."""
        self.set_identity(fitted)
        first = fitted.frames[0]
        found = self._search.search(frame, self._known.expected(first))
        self._offset = np.zeros(len(EAUS)) if found is None else found.eau - first.eau

    def set_identity(self, fitted: IdentityFit) -> None:
        """Use this identity from now on."""
        aau = fitted.identity.aau
        points = personalise(self._generic, aau, fitted.control_mm)
        self._person = _Person(points, fitted.camera, aau)

    def measure(self, frame: Picture, expected: FaceParameters) -> FedBackFace | None:
        """The face near an expected one; None where the model does not find it."""
        person, seen = self._known, replace(expected, eau=clip_eau(expected.eau + self._offset))
        found = self._search.search(frame, person.expected(seen))
        if found is None:
            return None
        at, eau = list(MEASURED_EAUS), expected.eau.copy()
        eau[at] = found.eau[at] - self._offset[at]
        start, sigma = replace(expected, eau=clip_eau(eau)), np.full(len(eau), np.inf)
        sigma[at] = found.eau_sigma[at]
        points_px, rounds = found.points_px, ITERATIONS_FROM_PREDICTION
        face = fit_landmarks(person.points, person.camera, points_px, start, (), rounds)
        return FedBackFace(face, sigma, self._search.sigma_ratio)

    @property
    def _known(self) -> "_Person":
        if self._person is None:
            raise ValueError("no face has been seen, expected start before measure")
        return self._person


@dataclass(frozen=True, slots=True)
class _Person:
    """points: personalised.  aau: (11,)."""

    points: LandmarkModel
    camera: Camera
    aau: Array

    def expected(self, face: FaceParameters) -> ExpectedFace:
        """What a search is told of a face of this person."""
        return expected_face(self.points, self.camera, face, self.aau)
