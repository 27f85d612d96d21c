"""One face parameter set per frame: a picture in, pose and actuators out, lightly filtered."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.photometric import NORMALISATIONS
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.detection.viola_jones import HaarDetector
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import TYPICAL_FOCAL, fit_identity
from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, landmark_model, personalise
from encoder.fitting.person_texture import FitOptions
from encoder.fitting.pose_initialisation import pose_from_three_points
from encoder.fitting.prediction_matrix import PredictionMatrixFitter
from encoder.fitting.symmetry import SymmetricTexelFitter
from encoder.tracking.detection_measurement import (
    FrameMeasurer,
    HaarMeasurer,
    LandmarkMeasurer,
    warn_of_several_faces,
)
from encoder.tracking.model_tracker import TRACKER_PARTS, ModelTracker
from protocol.frames.scalar_quantiser import sent_eaus
from shared_model.animate import identity_from_controls
from shared_model.anthropometry import residual_basis
from shared_model.errors import UserError
from shared_model.geometry import Camera, interpolate
from shared_model.mesh import Head
from shared_model.parameters import AAUS, EAU_INDEX, FaceParameters

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Warn = Callable[[str], None]

DETECTORS = ("network", "haar")
TRACKERS = ("single", "full")
# Steps of the analysis by synthesis: by each picture's own gradient, also with the far half of a
# turned face taken from the near one, or the thesis' own.
FITTERS: Mapping[str, type[TexelFitter]] = {
    "gauss-newton": TexelFitter,
    "mirrored": SymmetricTexelFitter,
    "matrix": PredictionMatrixFitter,
}
# What the thesis profile sends, and the lids even if it does not, lest blinks pass for the brows'
# motion.
TRACKED_EAUS = tuple(EAU_INDEX[name] for name in sent_eaus(with_eyelids=True))
# Share of a new measurement in the filtered value: little lag, and half of the jitter's power gone.
SMOOTHING_GAIN = 0.7


class FaceTracker(Protocol):
    """Follows one caller from frame to frame."""

    @property
    def fitted(self) -> IdentityFit:
        """The caller's identity.  Raises `ValueError` before the first face."""

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """Pose and actuators in the next frame (h, w, 3) BGR; None where there is no face.

        coming: the frame after it, see `LandmarkTracker.update`; changes nothing but the time.
        """

    @property
    def confidence(self) -> float:
        """How sure the newest face is, 0..1: 0 if there is none, or if an older one is repeated.

        Correlation of picture and person's texture where that is fitted, else the presence that the
        landmark network states, else 1.
        """

    def take_refined_identity(self) -> IdentityFit | None:
        """A better identity of the caller, once, with their face in the first frame.

        Faces are those of the one before until it is adopted.
        """

    def adopt(self, fitted: IdentityFit) -> None:
        """From the next frame on faces are those of the improved identity."""


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """How to follow a face.

    detector: what finds it, one of `DETECTORS`.
    tracker: "single" measures every frame by itself, "full" is `TrackingFollower`.
    without: parts of the full tracker to leave out, some of `track.PARTS`.
    normalise: what the full tracker fits of a picture, one of `photometric.NORMALISATIONS`.
    step: how its fit of the texture goes about it, one of `STEPS`.
    lids: see the lids by a network of their own, and send them.
    refine: improve the full tracker's identity of the caller while they are followed; nothing else
        has one to improve.
    """

    detector: str = "network"
    tracker: str = "full"
    without: frozenset[str] = frozenset()
    normalise: str = "none"
    step: str = "gauss-newton"
    eyelids: bool = False
    refine_identity: bool = True


def open_tracker(
    options: TrackingOptions,
    head: Head,
    size: tuple[int, int],
    active: Sequence[int],
    elapsed_s: float,
    warn: Warn,
) -> FaceTracker:
    """The follower for `options`; by Viola-Jones where the networks are missing.

    size: (width, height) of the picture.  active: actuators that may move after the first frame.
    elapsed_s: from frame to frame.  Raises `UserError` for an option that is not known.
    """
    _check("detector", [options.detector], DETECTORS)
    _check("tracker", [options.tracker], TRACKERS)
    _check("part", options.without, TRACKER_PARTS)
    _check("normalisation", [options.normalise], tuple(NORMALISATIONS))
    _check("step", [options.step], tuple(FITTERS))
    by_network = options.detector == "network"
    landmarks = _landmark_tracker(warn, options.eyelids) if by_network else None
    if options.tracker == "full":
        sighter: FrameMeasurer
        if landmarks is None:
            sighter = HaarMeasurer(head, size, HaarDetector(), warn)
        else:
            sighter = LandmarkMeasurer(head, size, active, landmarks, warn)
        synthesis = FitOptions(NORMALISATIONS[options.normalise], FITTERS[options.step])
        return ModelTracker(
            head, active, elapsed_s, sighter, options.without, synthesis, options.refine_identity
        )
    if landmarks is None:
        return HaarPoseTracker(head, size, HaarDetector(), warn)
    return LandmarkFitTracker(head, size, active, landmarks, warn)


def _check(what: str, chosen: Iterable[str], known: Sequence[str]) -> None:
    for name in chosen:
        if name not in known:
            raise UserError(f"{what} {name} is unknown; choose one of {', '.join(known)}")


def _landmark_tracker(warn: Warn, lids: bool) -> LandmarkTracker | None:
    try:
        folder = find_network_folder()
    except NetworkFilesMissing as error:
        warn(f"{error}; following by Viola-Jones")
        return None
    return LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=lids)


class FixedIdentityTracker:
    """A `Follower` whose caller stays as they were first seen."""

    def take_refined_identity(self) -> IdentityFit | None:
        """See `Follower`: there is none."""
        return None

    def adopt(self, fitted: IdentityFit) -> None:
        """See `Follower`.  Raises `ValueError`: no identity can have come from here."""
        raise ValueError("this follower improves no identity, expected none to adopt")


class LandmarkFitTracker(FixedIdentityTracker):
    """Pose and actuators by least squares on the landmark network's 468 points."""

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
        self._model: LandmarkModel | None = None
        self._fitted: IdentityFit | None = None
        self._last: FaceParameters | None = None
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `Follower`."""
        if self._fitted is None:
            raise ValueError("no face has been seen, expected update before fitted")
        return self._fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `Follower`."""
        found = self._tracker.update(frame, next_frame)
        warn_of_several_faces(self._tracker.face_count, self._warn)
        self.confidence = 0.0 if found is None else found.score
        if found is None:
            return None
        if self._model is None or self._last is None:
            return self._begin(found.points)
        face = fit_landmarks(
            self._model, self.fitted.camera, found.points, self._last, self._active
        )
        self._last = interpolate(self._last, face, SMOOTHING_GAIN)
        return self._last

    def _begin(self, points_px: Array) -> FaceParameters:
        fitted = fit_identity(self._head, self._size, [points_px])
        generic = landmark_model(self._head)
        self._model = personalise(generic, fitted.identity.aau, fitted.control_mm)
        self._fitted, self._last = fitted, fitted.frames[0]
        return self._last


class HaarPoseTracker(FixedIdentityTracker):
    """Pose alone, from Viola-Jones' eyes and the nose between (thesis 5.1); generic identity."""

    def __init__(
        self, head: Head, size: tuple[int, int], detector: HaarDetector, warn: Warn
    ) -> None:
        control = np.zeros((len(residual_basis(head)), 3))
        identity = identity_from_controls(head, np.zeros(len(AAUS)), control)
        self._fitted = IdentityFit(Camera(*size, TYPICAL_FOCAL * max(size)), identity, control, ())
        self._head, self._detector, self._warn = head, detector, warn
        self._last: FaceParameters | None = None
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `Follower`."""
        return self._fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `Follower`."""
        faces = self._detector.detect(frame)
        warn_of_several_faces(len(faces), self._warn)
        self.confidence = float(bool(faces))
        if not faces:
            return None
        face = FaceParameters(pose_from_three_points(self._head, self._fitted.camera, faces[0]))
        self._last = face if self._last is None else interpolate(self._last, face, SMOOTHING_GAIN)
        return self._last
