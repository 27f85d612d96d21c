"""Measurements of the face in single frames, by landmarks or by Viola-Jones' detector."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from encoder.detection.detector import Warn, warn_of_several_faces
from encoder.detection.landmark_indices import LANDMARK_COUNT, OUTER_EYE_CORNERS
from encoder.detection.viola_jones import HaarDetector
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity, generic_identity
from encoder.fitting.landmark_fit import (
    LandmarkModel,
    fit_landmarks,
    initial_parameters,
    landmark_model,
    personalise,
)
from encoder.fitting.landmark_source import ExpectedFace, LandmarkSource
from encoder.fitting.pose_initialisation import pose_from_three_points
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, pixel_from_head
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

# One landmark in so many is a measurement of the filter.
LANDMARK_STRIDE = 12
# Standard deviation of these, in units of the distance between the eyes; `LANDMARK_SIGMA` of the
# fits is that of all landmarks, which are correlated.
FILTER_LANDMARK_SIGMA = 0.015
# Iterations of the fit from a predicted face, and from a pose by weak perspective.
ITERATIONS_FROM_PREDICTION, ITERATIONS = 2, 4


@dataclass(frozen=True, slots=True)
class FrameMeasurement:
    """Measurement of the face in one frame.

    face: pose and actuators.  points_mm: (n, 3) head frame, in this expression; n may be 0.
    pixels: (n, 2) where the points were found.  variance_px2: (n,).
    sigma_ratio: see `LandmarkSource`.
    """

    face: FaceParameters
    points_mm: Array
    pixels: Array
    variance_px2: Array
    sigma_ratio: float = 1.0


class FrameMeasurer(Protocol):
    """Measures the face of one person.

    point_count: number of points of each measurement; 0: it does not measure every frame.
    """

    point_count: int

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """The identity in the picture (h, w, 3) BGR; None where no face is found."""

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """The face in a frame; None where none is found.

        predicted: where it is expected, None: anywhere.
        next_frame: the frame that follows, see `LandmarkSource.update`.
        """

    def set_identity(self, fitted: IdentityFit) -> None:
        """Use this identity from now on."""


class LandmarkMeasurer:
    """A `FrameMeasurer` by the landmarks of the network, or of a statistical model.

    active: actuators that may move after the first frame.
    """

    def __init__(
        self,
        head: Head,
        size: tuple[int, int],
        active: Sequence[int],
        source: LandmarkSource,
        warn: Warn,
    ) -> None:
        self._head, self._size, self._active = head, size, active
        self._source, self._warn = source, warn
        self._generic = self._model = landmark_model(head)
        self._chosen = np.arange(0, len(self._model.index), LANDMARK_STRIDE)
        generic = generic_identity(head, size)
        self._camera, self._aau = generic.camera, generic.identity.aau
        self.point_count = len(self._chosen) if source.every_frame else 0

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """See `FrameMeasurer`."""
        points_px = self._landmarks(frame)
        if points_px is None:
            return None
        ratio = self._source.sigma_ratio
        fitted = fit_identity(
            self._head, self._size, [points_px], active=self._active, sigma_ratio=ratio
        )
        self.set_identity(fitted)
        return fitted

    def set_identity(self, fitted: IdentityFit) -> None:
        """See `FrameMeasurer`."""
        self._model = personalise(self._generic, fitted.identity.aau, fitted.control_mm)
        self._camera, self._aau = fitted.camera, fitted.identity.aau

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """See `FrameMeasurer`."""
        # The prediction is more reliable than the source's own previous landmarks.
        model, camera = self._model, self._camera
        known = None
        if predicted is not None:
            known = expected_face(model, camera, predicted, self._aau)
        self._source.expect(known)
        points_px = self._landmarks(frame, next_frame)
        if points_px is None:
            return None
        start = predicted or initial_parameters(model, camera, points_px)
        iterations = ITERATIONS_FROM_PREDICTION if predicted else ITERATIONS
        face = fit_landmarks(model, camera, points_px, start, self._active, iterations)
        points_mm = animated_points(model, face.eau)[self._chosen]
        left, right = (points_px[corner, :2] for corner in OUTER_EYE_CORNERS)
        ratio = self._source.sigma_ratio
        sigma_px = ratio * FILTER_LANDMARK_SIGMA * np.linalg.norm(left - right)
        variance_px2 = np.full(len(self._chosen), sigma_px**2)
        pixels = points_px[model.index[self._chosen], :2]
        return FrameMeasurement(face, points_mm, pixels, variance_px2, ratio)

    def _landmarks(self, frame: Picture, next_frame: Picture | None = None) -> Array | None:
        found = self._source.update(frame, next_frame)
        warn_of_several_faces(self._source.face_count, self._warn)
        return None if found is None else found.points


class HaarMeasurer:
    """A `FrameMeasurer` by Viola-Jones' eyes and nose (thesis 5.1): generic identity, pose only."""

    point_count = 0

    def __init__(
        self, head: Head, size: tuple[int, int], detector: HaarDetector, warn: Warn
    ) -> None:
        self._head, self._size, self._detector, self._warn = head, size, detector, warn
        self._camera = generic_identity(head, size).camera

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """See `FrameMeasurer`."""
        measurement = self.measure(frame, None)
        if measurement is None:
            return None
        return replace(generic_identity(self._head, self._size), frames=(measurement.face,))

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """See `FrameMeasurer`."""
        faces = self._detector.detect(frame)
        warn_of_several_faces(len(faces), self._warn)
        if not faces:
            return None
        pose = pose_from_three_points(self._head, self._camera, faces[0])
        face = FaceParameters(pose) if predicted is None else replace(predicted, pose=pose)
        return FrameMeasurement(face, np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))

    def set_identity(self, fitted: IdentityFit) -> None:
        """See `FrameMeasurer`; the three points stay those of the generic head."""
        self._camera = fitted.camera


def animated_points(model: LandmarkModel, eau: Array) -> Array:
    """(m, 3) the model's points in an expression, mm, head frame."""
    up, down = np.maximum(eau, 0), np.maximum(-eau, 0)
    return np.asarray(
        model.neutral + np.tensordot(up, model.eau_up, 1) + np.tensordot(down, model.eau_down, 1)
    )


def expected_face(
    model: LandmarkModel, camera: Camera, face: FaceParameters, aau: Array
) -> ExpectedFace:
    """What a search is told of a face.  model: personalised.  aau: (11,) of the person."""
    points_px = np.full((LANDMARK_COUNT, 3), np.nan)
    animated = animated_points(model, face.eau)
    points_px[model.index, :2] = pixel_from_head(camera, face.pose, animated)
    return ExpectedFace(points_px, camera, face, aau)
