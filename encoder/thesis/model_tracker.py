"""Model-based tracking (thesis 5.2): landmarks and KLT -> EKF -> analysis by synthesis -> EKF.

Each of the four can be left out; the others still track the face.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.capture.colour import luma_u8
from encoder.fitting.fit_results import IdentityFit, TextureFit
from encoder.fitting.pose_initialisation import pose_from_points
from encoder.thesis.coarse_to_fine import fit_coarse_to_fine, initial_faces
from encoder.thesis.detection_measurement import FrameMeasurement, FrameMeasurer
from encoder.thesis.identity_refinement import MIN_EYE_DISTANCE_PX, IdentityRefiner
from encoder.thesis.klt import KltTracker, Tracks, eye_distance_px
from encoder.thesis.measurement_fusion import MeasurementFusion
from encoder.thesis.model_feedback import ModelFeedback
from encoder.thesis.person_texture import GOOD_CORRELATION, MAX_ATLAS_SIZES, PersonTexture
from encoder.thesis.tracking_options import TrackingOptions
from shared_model.animate import Face
from shared_model.arrays import Picture, VertexIndices
from shared_model.geometry import matrix_from_quaternion, rotation_angle_deg
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters, Pose, with_focal_change

# Number of points by which the fit of the texture is passed to the filter.
FIT_POINTS = 20
# KLT points from which a pose is computed without the filter.
MIN_POSE_POINTS = 6
# Iterations of the fit, coarse and fine: in each frame, and after the face was lost.
ITERATIONS = (3, 2)
RECOVERY_ITERATIONS = (8, 5)
# Correlation with the person's texture, in the frame before and in this one, from which the fit is
# believed without the places of landmarks: those of turned heads are off by up to 25 degrees, all
# alike, so that no gate finds them.
TRUSTED_CORRELATION = 0.95
# The same where landmarks have a pose that is so many degrees from the predicted one: then they are
# those that are wrong.
DISPUTED_CORRELATION, DISPUTED_DEG = 0.8, 12.0
# Successive frames without a trustworthy face after which it is lost.
LOST_AFTER_FRAMES = 3
# Correlation with the person's texture below which tracking has failed.
MIN_CORRELATION = 0.5
# The same in frames in which the landmark network finds no face.
MIN_CORRELATION_UNDETECTED = 0.75
# The same for a face that is found again, which needs more evidence than one that is tracked.
MIN_CORRELATION_RECOVERED = 0.6
# Share of the KLT points that are tracked, below which KLT alone has failed.
MIN_INLIER_SHARE = 0.3
# Ratio to the first depth, or inverse ratio, from which a pose is implausible.
MAX_DEPTH_RATIO = 6.0


@dataclass(frozen=True, slots=True)
class TrackedPerson:
    """The person in the call.

    fit_points: (k,) vertices, see `MeasurementFusion`.
    """

    fitted: IdentityFit
    face: Face
    textures: tuple[PersonTexture, ...]
    klt: KltTracker
    fit_points: VertexIndices


class ModelTracker:
    """A `FaceTracker` that fuses landmarks, KLT and the fit of the person's textured model.

    active: actuators that may move after the first frame.  elapsed_s: from frame to frame.
    measurer: finds the face first and after it was lost; also measures every frame unless "network"
        is left out.
    options: of the full tracker.
    """

    def __init__(
        self,
        head: Head,
        active: Sequence[int],
        elapsed_s: float,
        measurer: FrameMeasurer,
        options: TrackingOptions,
    ) -> None:
        self._head, self._active, self._options = head, list(active), options
        self._elapsed_s, self._measurer = elapsed_s, measurer
        search = options.expression_search
        self._feedback = None if search is None else ModelFeedback(head, search)
        self._person: TrackedPerson | None = None
        self._identity_refiner: IdentityRefiner | None = None
        self._fusion: MeasurementFusion | None = None
        self._last: FaceParameters | None = None
        self._failures = self._frame_number = 0
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `FaceTracker`."""
        if self._person is None:
            raise ValueError("no face has been seen, expected update before fitted")
        return self._person.fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `FaceTracker`."""
        self._frame_number += 1
        if self._person is None:
            return self._initialise(frame)
        if self._last is None:
            return self._recover(self._person, frame)
        return self._track(self._person, self._last, frame, next_frame)

    def take_refined_identity(self) -> IdentityFit | None:
        """See `FaceTracker`."""
        refiner = self._identity_refiner
        return refiner.take_result() if refiner is not None else None

    def adopt(self, fitted: IdentityFit) -> None:
        """See `FaceTracker`."""
        if self._person is None or self._identity_refiner is None:
            raise ValueError("no identity is refined, expected take_refined_identity before adopt")
        before, face = self._person, Face(self._head, fitted.identity)
        for texture in before.textures:
            texture.set_shape(face, fitted.camera, fitted.frames[0])
        before.klt.set_face(face)
        self._measurer.set_identity(fitted)
        if self._feedback is not None:
            self._feedback.set_identity(fitted)
        self._identity_refiner.adopt(fitted)
        self._person = replace(before, fitted=fitted, face=face)
        if self._last is not None:
            ratio = fitted.camera.focal_px / before.fitted.camera.focal_px
            self._restart(self._person, with_focal_change(self._last, ratio))

    def _has(self, part: str) -> bool:
        return part not in self._options.without

    def _has_landmarks(self) -> bool:
        return self._has("network") and self._measurer.point_count > 0

    def _initialise(self, frame: Picture) -> FaceParameters | None:
        fitted = self._measurer.initialise(frame)
        if fitted is None:
            return None
        if self._feedback is not None:
            self._feedback.start(frame, fitted)
        luma = luma_u8(frame)
        face, start, camera = Face(self._head, fitted.identity), fitted.frames[0], fitted.camera
        textures = tuple(
            PersonTexture(
                self._head,
                face,
                camera,
                luma,
                start,
                size,
                self._options.normalisation,
                self._options.fitter,
            )
            for size in MAX_ATLAS_SIZES
        )
        follows = self._options.klt_points == "visible"
        klt = KltTracker(face, luma, camera, start, replace_hidden=follows)
        chosen = np.linspace(0, len(klt.index) - 1, min(FIT_POINTS, len(klt.index))).astype(int)
        self._person = TrackedPerson(fitted, face, textures, klt, klt.index[chosen])
        if self._can_refine(fitted):
            first = textures[-1].observe(luma, start)
            self._identity_refiner = IdentityRefiner(
                self._head, fitted, textures[-1], first, self._active
            )
        self.confidence = 1.0
        self._restart(self._person, start)
        return start

    def _can_refine(self, fitted: IdentityFit) -> bool:
        is_large = eye_distance_px(fitted.camera, fitted.frames[0].pose) > MIN_EYE_DISTANCE_PX
        has_information = fitted.information is not None
        return self._options.refine_identity and self._has("abs") and has_information and is_large

    def _restart(self, person: TrackedPerson, face: FaceParameters) -> None:
        """Track from `face` on, with a new filter."""
        if self._has("ekf"):
            self._fusion = MeasurementFusion(
                person.fitted.camera,
                person.face,
                face,
                self._active,
                len(person.klt.index),
                self._measurer.point_count,
                person.fit_points,
                self._options.measurement_model,
                self._options.free_focal,
            )
        self._last, self._failures = face, 0

    def _track(
        self,
        person: TrackedPerson,
        last: FaceParameters,
        frame: Picture,
        next_frame: Picture | None,
    ) -> FaceParameters | None:
        predicted = last
        if self._fusion is not None:
            predicted = self._fusion.predict(last, self._elapsed_s)
        measurement = None
        if self._has_landmarks():
            measurement = self._measurer.measure(frame, predicted, next_frame)
        if measurement is not None and not is_plausible(measurement.face, person.fitted):
            measurement = None
        luma, camera = luma_u8(frame), person.fitted.camera
        tracks = person.klt.track(luma, camera, predicted) if self._has("klt") else None
        needed = TRUSTED_CORRELATION
        if measurement is not None and _disagree(measurement.face.pose, predicted.pose):
            needed = DISPUTED_CORRELATION
        trusted = self.confidence >= needed and self._has("abs")
        start = self._fuse(person, predicted, measurement, tracks, trusted)
        start = self._fed_back(frame, start)
        fit = None
        if self._has("abs"):
            fit = self._fit(person, luma, initial_faces(start, measurement), ITERATIONS)
        confidence = 1.0 if fit is None else max(0.0, fit.correlation)
        if trusted and confidence < needed and self._fusion is not None:
            start = self._fusion.update(start, points_of=measurement)
        if fit is not None and fit.correlation < MIN_CORRELATION and measurement is not None:
            # Landmarks find a face that the texture does not match: they are used alone.
            start, fit = measurement.face, None
        elif is_tracking_failure(self._has_landmarks() and measurement is None, tracks, fit):
            return self._coast(last)
        face = self._update_with_fit(start, fit)
        if not is_plausible(face, person.fitted):
            return self._coast(last)
        if fit is not None:
            self._update_model(person, luma, fit, face)
        person.klt.reset_points(luma, camera, face)
        self.confidence = confidence
        self._last, self._failures = face, 0
        return face

    def _fuse(
        self,
        person: TrackedPerson,
        predicted: FaceParameters,
        measurement: FrameMeasurement | None,
        tracks: Tracks | None,
        actuators_alone: bool,
    ) -> FaceParameters:
        """The face by landmarks, or their actuators alone, and KLT points."""
        if self._fusion is not None:
            places = None if actuators_alone else measurement
            return self._fusion.update(predicted, tracks, places, measurement)
        if measurement is not None:
            return measurement.face
        if tracks is None:
            return predicted
        tracked = np.isfinite(tracks.variance_px2)
        if tracked.sum() < MIN_POSE_POINTS:
            return predicted
        points_mm, pixels = tracks.points_mm[tracked], tracks.pixels[tracked]
        pose = pose_from_points(person.fitted.camera, points_mm, pixels, predicted.pose)
        return replace(predicted, pose=pose)

    def _fed_back(self, frame: Picture, start: FaceParameters) -> FaceParameters:
        """The filter's face after what a statistical model measures from it on (5.2)."""
        if self._feedback is None or self._fusion is None:
            return start
        found = self._feedback.measure(frame, start)
        return start if found is None else self._fusion.update(start, fed_back=found)

    def _fit(
        self,
        person: TrackedPerson,
        luma: Picture,
        starts: Sequence[FaceParameters],
        iterations: Sequence[int],
    ) -> TextureFit:
        return fit_coarse_to_fine(
            person.textures, luma, starts, self._active, iterations, self._frame_number
        )

    def _update_with_fit(self, start: FaceParameters, fit: TextureFit | None) -> FaceParameters:
        """The face by the fit of the texture, filtered."""
        if fit is None:
            return start
        return fit.face if self._fusion is None else self._fusion.update(start, fit=fit)

    def _update_model(
        self, person: TrackedPerson, luma: Picture, fit: TextureFit, face: FaceParameters
    ) -> None:
        for texture in person.textures:
            texture.update_template(luma, fit)
        if self._identity_refiner is not None:
            self._identity_refiner.advance(self._elapsed_s)
            if fit.correlation > GOOD_CORRELATION:
                self._identity_refiner.add_keyframe_candidate(luma, face)

    def _coast(self, last: FaceParameters) -> FaceParameters | None:
        """Repeat the last face for a few frames; then the face is lost."""
        self._failures += 1
        self.confidence = 0.0
        if self._failures < LOST_AFTER_FRAMES:
            return last
        self._last = None
        return None

    def _recover(self, person: TrackedPerson, frame: Picture) -> FaceParameters | None:
        """Find the same person anywhere in the picture."""
        measurement = self._measurer.measure(frame, None)
        if measurement is None or not is_plausible(measurement.face, person.fitted):
            return None
        face, luma, confidence = measurement.face, luma_u8(frame), 1.0
        if self._has("abs"):
            fit = self._fit(person, luma, [face], RECOVERY_ITERATIONS)
            confidence = max(0.0, fit.correlation)
            if fit.correlation >= MIN_CORRELATION_RECOVERED:
                face = fit.face
            elif not self._has_landmarks():
                return None
        person.klt.reset_points(luma, person.fitted.camera, face)
        self._restart(person, face)
        self.confidence = confidence
        return face


def _disagree(a: Pose, b: Pose) -> bool:
    """Whether the rotations of two poses are more than `DISPUTED_DEG` apart."""
    between = matrix_from_quaternion(a.rotation).T @ matrix_from_quaternion(b.rotation)
    return rotation_angle_deg(between) > DISPUTED_DEG


def is_tracking_failure(undetected: bool, tracks: Tracks | None, fit: TextureFit | None) -> bool:
    """Whether the measurements of a frame contradict the predicted face.

    undetected: the landmark network has processed the frame and found no face.
    """
    if fit is not None:
        return fit.correlation < (MIN_CORRELATION_UNDETECTED if undetected else MIN_CORRELATION)
    return undetected or (tracks is not None and tracks.inlier_share < MIN_INLIER_SHARE)


def is_plausible(face: FaceParameters, fitted: IdentityFit) -> bool:
    """Whether the head is in front of the camera, at a depth comparable to the first one."""
    ratio = face.pose.translation_mm[2] / fitted.frames[0].pose.translation_mm[2]
    return bool(1 / MAX_DEPTH_RATIO < ratio < MAX_DEPTH_RATIO)
