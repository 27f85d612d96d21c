"""Fusion of KLT tracks, landmarks and the fit of the texture by the extended Kalman filter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from encoder.fitting.analysis_by_synthesis import MIN_RESIDUAL_SIGMA_GREY, RESIDUAL_SIGMA_GREY
from encoder.fitting.fit_results import TextureFit
from encoder.thesis.detection_measurement import FrameMeasurement
from encoder.thesis.ekf import Estimate, FaceFilter, InitialUncertainty, Measurements, ProcessNoise
from encoder.thesis.klt import Tracks, eye_distance_px
from encoder.thesis.measurement_model import Projection, perspective
from encoder.thesis.model_feedback import FedBackFace
from shared_model.animate import Face
from shared_model.arrays import Array, VertexIndices
from shared_model.geometry import Camera, matrix_from_quaternion, pixel_from_head
from shared_model.parameters import LIDS, FaceParameters, Pose, clip_eau, with_focal_change

# Standard deviation of the fit's points, in units of the distance between the eyes.
FIT_POINT_SIGMA = 0.012
# Standard deviations of actuators: of the fit at the default residual, proportional to the residual
# where that is smaller; of landmarks.
FIT_EAU_SIGMA = 0.06
LANDMARK_EAU_SIGMA = 0.07
# Angle between the line of sight and the direction of the face at which errors of landmarks double.
ERROR_DOUBLING_DEG = 15.0


class MeasurementFusion:
    """Filters one person's face from frame to frame.

    camera, face: of the person.  start: the first face.  active: actuators that move.
    klt_count, landmark_count: number of points of each measurement.
    fit_points: (k,) vertices that represent the pose of the fit as measured points.
    projection: the measurement model.
    free_focal: the focal length is estimated with the pose (4.6), not held.
    """

    def __init__(
        self,
        camera: Camera,
        face: Face,
        start: FaceParameters,
        active: Sequence[int],
        klt_count: int,
        landmark_count: int,
        fit_points: VertexIndices,
        projection: Projection = perspective,
        free_focal: bool = False,
    ) -> None:
        self._camera, self._face, self._active = camera, face, list(active)
        self._fit_points = fit_points
        self._klt = slice(klt_count)
        self._landmarks = slice(klt_count, klt_count + landmark_count)
        self._count = klt_count + landmark_count + len(fit_points)
        self._fit = slice(klt_count + landmark_count, self._count)
        # The wire has one focal length, that of the identity.  A free one drifts together with the
        # depth, since one head hardly determines both.
        noise, uncertainty = ProcessNoise(focal_per_s=0.0), InitialUncertainty(focal_share=1e-6)
        if free_focal:
            noise, uncertainty = ProcessNoise(), InitialUncertainty()
        self._free_focal = free_focal
        eau = start.eau[self._active]
        self._filter = FaceFilter(
            camera, start.pose, eau, self._count, noise, uncertainty, projection
        )

    def predict(self, last: FaceParameters, elapsed_s: float) -> FaceParameters:
        """The predicted face of the next frame."""
        return self._with_estimate(last, self._filter.predict(elapsed_s))

    def update(
        self,
        predicted: FaceParameters,
        tracks: Tracks | None = None,
        points_of: FrameMeasurement | None = None,
        actuators_of: FrameMeasurement | None = None,
        fit: TextureFit | None = None,
        fed_back: FedBackFace | None = None,
    ) -> FaceParameters:
        """The face after an update by the given measurements; the others are taken as missing.

        points_of, actuators_of: landmarks of which the places count, and the actuators.
        Of `actuators_of`, `fit` and `fed_back` one at most.
        """
        points, pixels = np.zeros((self._count, 3)), np.zeros((self._count, 2))
        variance = np.full(self._count, np.inf)
        eau, eau_variance = predicted.eau[self._active], np.full(len(self._active), np.inf)
        if tracks is not None:
            points[self._klt], pixels[self._klt] = tracks.points_mm, tracks.pixels
            variance[self._klt] = tracks.variance_px2
        if points_of is not None:
            at = self._landmarks
            points[at], pixels[at] = points_of.points_mm, points_of.pixels
            variance[at] = _variance_factor(points_of) * points_of.variance_px2
        if actuators_of is not None:
            eau = actuators_of.face.eau[self._active]
            sigma = actuators_of.sigma_ratio * LANDMARK_EAU_SIGMA
            eau_variance[:] = _variance_factor(actuators_of) * sigma**2
        if fit is not None:
            self._place_points(fit.face, 1.0, points, pixels, variance)
            eau = fit.face.eau[self._active]
            eau_variance[:] = self._fit_eau_variance(fit)
        if fed_back is not None:
            self._place_points(fed_back.face, fed_back.sigma_ratio, points, pixels, variance)
            eau = fed_back.face.eau[self._active]
            eau_variance[:] = fed_back.eau_sigma[self._active] ** 2
        estimate = self._filter.update(Measurements(points, pixels, variance, eau, eau_variance))
        return self._with_estimate(predicted, estimate)

    def _place_points(
        self,
        face: FaceParameters,
        sigma_ratio: float,
        points: Array,
        pixels: Array,
        variance: Array,
    ) -> None:
        """Measure the pose of a fitted face as points."""
        at, pose = self._fit, face.pose
        points[at] = self._face.animate(face.eau)[self._fit_points]
        pixels[at] = pixel_from_head(self._camera, pose, points[at])
        sigma_px = sigma_ratio * FIT_POINT_SIGMA * eye_distance_px(self._camera, pose)
        variance[at] = sigma_px**2

    def _fit_eau_variance(self, fit: TextureFit) -> Array:
        sigma_grey = np.clip(fit.residual_sigma_grey, MIN_RESIDUAL_SIGMA_GREY, RESIDUAL_SIGMA_GREY)
        # The texture does not show closed lids: landmarks measure them at least as well.
        is_lid = np.isin(self._active, LIDS)
        factor = np.where(is_lid, 1.0, sigma_grey / RESIDUAL_SIGMA_GREY)
        return np.asarray((factor * FIT_EAU_SIGMA) ** 2)

    def _with_estimate(self, face: FaceParameters, estimate: Estimate) -> FaceParameters:
        eau = face.eau.copy()
        eau[self._active] = estimate.eau
        found = replace(face, pose=estimate.pose, eau=clip_eau(eau))
        if not self._free_focal:
            return found
        # What is drawn and fitted has the identity's focal length.
        return with_focal_change(found, self._camera.focal_px / estimate.camera.focal_px)


def _variance_factor(landmarks: FrameMeasurement) -> float:
    """By how much landmarks of a turned face vary more than those of a frontal one."""
    # By the measured angle: a filter with a wrong angle would reject the landmarks.
    angle_deg = _off_axis_deg(landmarks.face.pose)
    return (1 + (angle_deg / ERROR_DOUBLING_DEG) ** 2) ** 2


def _off_axis_deg(pose: Pose) -> float:
    """Angle between the direction of the face and that to the camera, degrees."""
    to_camera = -pose.translation_mm / np.linalg.norm(pose.translation_mm)
    face_direction = matrix_from_quaternion(pose.rotation)[:, 2]
    return float(np.degrees(np.arccos(np.clip(face_direction @ to_camera, -1, 1))))
