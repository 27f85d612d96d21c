"""The caller as one frame shows them, without the frame before: by landmarks or by Viola-Jones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import LANDMARK_COUNT, OUTER_EYE_CORNERS
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.roi import RotatedRoi, roi_from_landmarks
from encoder.detection.viola_jones import HaarDetector
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import TYPICAL_FOCAL, fit_identity
from encoder.fitting.landmark_fit import (
    LandmarkModel,
    fit_landmarks,
    initial_parameters,
    landmark_model,
    personalise,
)
from encoder.fitting.pose_initialisation import pose_from_three_points
from shared_model.animate import identity_from_controls
from shared_model.anthropometry import residual_basis
from shared_model.geometry import Camera, pixel_from_head
from shared_model.mesh import Head
from shared_model.parameters import AAUS, FaceParameters

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Warn = Callable[[str], None]

# Every so many of the landmarks goes to the filter, their error in units of the eyes' distance.
EVERY = 12
SIGMA = 0.015
# Steps of the landmarks' fit where the face is nearly known.
STEPS = 2


@dataclass(frozen=True, slots=True)
class FrameMeasurement:
    """The caller in one frame.

    face: pose and actuators.  points_mm: (n, 3) head frame, in this expression, and where they
    were seen: pixels (n, 2), variance_px2 (n,).  n may be 0.
    """

    face: FaceParameters
    points_mm: Array
    pixels: Array
    variance_px2: Array


class FrameMeasurer(Protocol):
    """Finds the caller.  point_count: how many points each `Sight` brings."""

    point_count: int

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """Who is in the picture (h, w, 3) BGR; None where nobody is."""

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """The same caller; near: about where, None where that is not known.

        coming: the next frame, see `LandmarkTracker.update`.
        """

    def set_identity(self, fitted: IdentityFit) -> None:
        """The caller is this from now on."""


class LandmarkMeasurer:
    """By the landmark network.  active: the actuators that may move after the first frame."""

    def __init__(
        self,
        head: Head,
        size: tuple[int, int],
        active: Sequence[int],
        tracker: LandmarkTracker,
        warn: Warn,
    ) -> None:
        self._head, self._size, self._active = head, size, active
        self._tracker, self._warn = tracker, warn
        self._generic = self._model = landmark_model(head)
        self._chosen = np.arange(0, len(self._model.index), EVERY)
        self._camera = Camera(*size, TYPICAL_FOCAL * max(size))
        self.point_count = len(self._chosen)

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """See `Sighter`."""
        points = self._points(frame)
        if points is None:
            return None
        fitted = fit_identity(self._head, self._size, [points], active=self._active)
        self.set_identity(fitted)
        return fitted

    def set_identity(self, fitted: IdentityFit) -> None:
        """See `Sighter`."""
        self._model = personalise(self._generic, fitted.identity.aau, fitted.control_mm)
        self._camera = fitted.camera

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """See `Sighter`."""
        # Where the network's last landmarks have strayed the tracker knows better.
        self._tracker.set_roi(None if predicted is None else self._square(predicted))
        points = self._points(frame, next_frame)
        if points is None:
            return None
        model, camera = self._model, self._camera
        start = predicted or initial_parameters(model, camera, points)
        face = fit_landmarks(model, camera, points, start, self._active, STEPS if predicted else 4)
        shape = animated_points(model, face.eau)[self._chosen]
        eyes_px = np.linalg.norm(
            points[OUTER_EYE_CORNERS[0], :2] - points[OUTER_EYE_CORNERS[1], :2]
        )
        variance = np.full(self.point_count, (SIGMA * eyes_px) ** 2)
        return FrameMeasurement(face, shape, points[model.index[self._chosen], :2], variance)

    def _square(self, face: FaceParameters) -> RotatedRoi:
        """Where the network should look for the caller's face."""
        points = np.full((LANDMARK_COUNT, 3), np.nan)
        points[self._model.index, :2] = pixel_from_head(
            self._camera, face.pose, animated_points(self._model, face.eau)
        )
        return roi_from_landmarks(points)

    def _points(self, frame: Picture, next_frame: Picture | None = None) -> Array | None:
        found = self._tracker.update(frame, next_frame)
        warn_of_several_faces(self._tracker.face_count, self._warn)
        return None if found is None else found.points


class HaarMeasurer:
    """By Viola-Jones' eyes and the nose between (thesis 5.1): generic identity, pose only."""

    point_count = 0

    def __init__(
        self, head: Head, size: tuple[int, int], detector: HaarDetector, warn: Warn
    ) -> None:
        self._head, self._detector, self._warn = head, detector, warn
        self._camera = Camera(*size, TYPICAL_FOCAL * max(size))

    def initialise(self, frame: Picture) -> IdentityFit | None:
        """See `Sighter`."""
        seen = self.measure(frame, None)
        if seen is None:
            return None
        control = np.zeros((len(residual_basis(self._head)), 3))
        identity = identity_from_controls(self._head, np.zeros(len(AAUS)), control)
        return IdentityFit(self._camera, identity, control, (seen.face,))

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        """See `Sighter`."""
        faces = self._detector.detect(frame)
        warn_of_several_faces(len(faces), self._warn)
        if not faces:
            return None
        pose = pose_from_three_points(self._head, self._camera, faces[0])
        face = FaceParameters(pose) if predicted is None else replace(predicted, pose=pose)
        return FrameMeasurement(face, np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))

    def set_identity(self, fitted: IdentityFit) -> None:
        """See `Sighter`: a head's three points are nobody's."""
        self._camera = fitted.camera


def animated_points(model: LandmarkModel, eau: Array) -> Array:
    """(m, 3) the model's points, mm, head frame, in an expression."""
    up, down = np.maximum(eau, 0), np.maximum(-eau, 0)
    return np.asarray(
        model.neutral + np.tensordot(up, model.eau_up, 1) + np.tensordot(down, model.eau_down, 1)
    )


def warn_of_several_faces(faces: int, warn: Warn) -> None:
    """Say that several faces are in the picture."""
    if faces > 1:
        warn(f"{faces} faces in the picture: taking the largest")
