"""The trackers' common interface and factory, and trackers that measure every frame by itself."""

from collections.abc import Sequence
from typing import Protocol

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import Warn, warn_of_several_faces
from encoder.detection.landmarks import Landmarks, LandmarkTracker
from encoder.detection.roi import roi_from_landmarks
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.detection.viola_jones import HaarDetector
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity, generic_identity
from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, landmark_model, personalise
from encoder.fitting.landmark_source import ExpectedFace, LandmarkSource
from encoder.fitting.pose_initialisation import pose_from_three_points
from encoder.thesis.detection_measurement import (
    FrameMeasurer,
    HaarMeasurer,
    LandmarkMeasurer,
)
from encoder.thesis.model_tracker import ModelTracker
from encoder.thesis.tracking_options import TrackingOptions
from protocol.frames.scalar_quantiser import sent_eaus
from shared_model.arrays import Array, Picture
from shared_model.geometry import interpolate
from shared_model.mesh import Head
from shared_model.parameters import EAU_INDEX, FaceParameters

# The actuators of the thesis profile, and the lids even if they are not sent: brows would otherwise
# be fitted to blinks.
TRACKED_EAUS = tuple(EAU_INDEX[name] for name in sent_eaus(with_eyelids=True))
# Weight of a new measurement in the filtered value: little lag, and half the power of the jitter.
SMOOTHING_GAIN = 0.7


class FaceTracker(Protocol):
    """Tracks the face of one person: a picture in, pose and actuators out."""

    @property
    def fitted(self) -> IdentityFit:
        """The identity of the person.  Raises `ValueError` before the first face."""

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """Pose and actuators in a frame (h, w, 3) BGR; None where there is no face.

        next_frame: the frame that follows, see `LandmarkSource.update`; saves time only.
        """

    @property
    def confidence(self) -> float:
        """Confidence of the newest face, 0..1: 0 if there is none, or if an older one is repeated.

        Correlation of picture and person's texture where that is fitted, else the presence that the
        source of the landmarks states, else 1.
        """

    def take_refined_identity(self) -> IdentityFit | None:
        """A better identity, once, with the face in the first frame.

        Faces refer to the previous identity until it is adopted.
        """

    def adopt(self, fitted: IdentityFit) -> None:
        """Use a refined identity from the next frame on."""


def open_tracker(
    options: TrackingOptions,
    head: Head,
    size: tuple[int, int],
    active: Sequence[int],
    elapsed_s: float,
    warn: Warn,
) -> FaceTracker:
    """The tracker for `options`; with Viola-Jones' detector where the networks are missing.

    size: (width, height) of the picture.  active: actuators that may move after the first frame.
    elapsed_s: from frame to frame.
    """
    landmarks = options.landmarks
    if landmarks is None and options.detector == "network":
        landmarks = _network_landmarks(warn, options.eyelids)
    if options.tracker == "full":
        measurer: FrameMeasurer
        if landmarks is None:
            measurer = HaarMeasurer(head, size, HaarDetector(options.nose), warn)
        else:
            measurer = LandmarkMeasurer(head, size, active, landmarks, warn)
        return ModelTracker(head, active, elapsed_s, measurer, options)
    if landmarks is None:
        return HaarPoseTracker(head, size, HaarDetector(options.nose), warn)
    return LandmarkFitTracker(head, size, active, landmarks, warn)


class NetworkLandmarks:
    """A `LandmarkSource` by the network, which looks where the face is expected."""

    sigma_ratio, every_frame = 1.0, True

    def __init__(self, tracker: LandmarkTracker) -> None:
        self._tracker = tracker

    @property
    def face_count(self) -> int:
        """See `LandmarkSource`."""
        return self._tracker.face_count

    def expect(self, face: ExpectedFace | None) -> None:
        """See `LandmarkSource`."""
        self._tracker.set_roi(None if face is None else roi_from_landmarks(face.points_px))

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        """See `LandmarkSource`."""
        return self._tracker.update(frame, next_frame)


def _network_landmarks(warn: Warn, eyelids: bool) -> NetworkLandmarks | None:
    try:
        folder = find_network_folder()
    except NetworkFilesMissing as error:
        warn(f"{error}; tracking with Viola-Jones' detector")
        return None
    tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=eyelids)
    return NetworkLandmarks(tracker)


class FixedIdentityTracker:
    """A `FaceTracker` whose identity stays that of the first face."""

    def take_refined_identity(self) -> IdentityFit | None:
        """See `FaceTracker`; always None."""
        return None

    def adopt(self, fitted: IdentityFit) -> None:
        """See `FaceTracker`.  Raises `ValueError`: no identity can come from this tracker."""
        raise ValueError("this tracker refines no identity, expected none to adopt")


class LandmarkFitTracker(FixedIdentityTracker):
    """Pose and actuators by least squares on the landmarks of each frame."""

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
        self._model: LandmarkModel | None = None
        self._fitted: IdentityFit | None = None
        self._last: FaceParameters | None = None
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `FaceTracker`."""
        if self._fitted is None:
            raise ValueError("no face has been seen, expected update before fitted")
        return self._fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `FaceTracker`."""
        found = self._source.update(frame, next_frame)
        warn_of_several_faces(self._source.face_count, self._warn)
        self.confidence = 0.0 if found is None else found.score
        if found is None:
            return None
        if self._model is None or self._last is None:
            return self._initialise(found.points)
        face = fit_landmarks(
            self._model, self.fitted.camera, found.points, self._last, self._active
        )
        self._last = interpolate(self._last, face, SMOOTHING_GAIN)
        return self._last

    def _initialise(self, points_px: Array) -> FaceParameters:
        ratio = self._source.sigma_ratio
        fitted = fit_identity(self._head, self._size, [points_px], sigma_ratio=ratio)
        generic = landmark_model(self._head)
        self._model = personalise(generic, fitted.identity.aau, fitted.control_mm)
        self._fitted, self._last = fitted, fitted.frames[0]
        return self._last


class HaarPoseTracker(FixedIdentityTracker):
    """Pose alone, from Viola-Jones' eyes and nose (thesis 5.1); generic identity."""

    def __init__(
        self, head: Head, size: tuple[int, int], detector: HaarDetector, warn: Warn
    ) -> None:
        self._fitted = generic_identity(head, size)
        self._head, self._detector, self._warn = head, detector, warn
        self._last: FaceParameters | None = None
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `FaceTracker`."""
        return self._fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `FaceTracker`."""
        faces = self._detector.detect(frame)
        warn_of_several_faces(len(faces), self._warn)
        self.confidence = float(bool(faces))
        if not faces:
            return None
        face = FaceParameters(pose_from_three_points(self._head, self._fitted.camera, faces[0]))
        self._last = face if self._last is None else interpolate(self._last, face, SMOOTHING_GAIN)
        return self._last
