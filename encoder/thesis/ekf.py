"""Extended Kalman filter over pose, focal length and actuators (thesis 4.3 and A.2), on filterpy.

The state is s = (t_x, t_y, t_z, w_x, w_y, w_z, f, [six velocities of t and w], a_1 .. a_k) (4.1):
t_x, t_y are the position of the head's origin in the picture, pixels from the principal point; t_z
is its depth, mm; w is a small rotation relative to a reference quaternion outside the state,
radians, camera frame; f is the focal length, pixels; a are the actuators, measured directly (4.16).
After every step w is multiplied into the quaternion (4.17-4.19) and reset to zero, so that the
Jacobian of Table 4.1 is exact.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from encoder.thesis.measurement_model import Projection, perspective
from encoder.thesis.outlier_rejection import robust_residuals
from shared_model.arrays import Array, Mask
from shared_model.geometry import (
    Camera,
    matrix_from_quaternion,
    multiply,
    normalise,
    quaternion_from_vector,
)
from shared_model.parameters import Pose

_RIGID = 7
# Measured information about a direction of the state, relative to the prior's, below which the
# measurement is dropped.
_MIN_INFORMATION = 1e-12


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """Process noise of heads and faces, as standard deviations.

    velocities: True is the constant-velocity model (4.4), False the thesis' simplified vector.
    acceleration_mm_s2, acceleration_rad_s2: of the velocities.
    speed_mm_s, speed_rad_s: drift of the head in the simplified vector.
    eau_per_s: drift of the actuators.
    focal_per_s: relative drift of the focal length.
    """

    velocities: bool = True
    acceleration_mm_s2: float = 2500.0
    acceleration_rad_s2: float = 12.0
    speed_mm_s: float = 150.0
    speed_rad_s: float = 1.2
    eau_per_s: float = 4.0
    focal_per_s: float = 0.001


@dataclass(frozen=True, slots=True)
class InitialUncertainty:
    """Uncertainty of the first state, as standard deviations."""

    pixels: float = 3.0
    depth_share: float = 0.03
    rotation_rad: float = 0.06
    focal_share: float = 0.1
    speed_mm_s: float = 200.0
    speed_rad_s: float = 1.0
    eau: float = 0.3


@dataclass(frozen=True, slots=True)
class Estimate:
    """The state of the filter as parameters of a face.

    pose: of the head, camera frame.
    camera: with the focal length of the state, the one that projects the pose correctly.
    eau: (k,) float64, the filtered actuators.
    inliers: (n,) bool, whether each point was used in the last update.
    normalised_innovation: root mean square innovation of the visible points in standard deviations,
        before outliers are rejected: about 1 at most where the face moves as predicted, large where
        it jumps or is lost.
    """

    pose: Pose
    camera: Camera
    eau: Array
    inliers: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    normalised_innovation: float = 0.0


@dataclass(frozen=True, slots=True)
class Measurements:
    """What is measured of one frame.

    points_mm: (n, 3) float64, mm, head frame, in the present expression.
    pixels: (n, 2) float64, their measured positions; ignored where the variance is infinite.
    variance_px2: (n,) float64, px^2; infinite where not measured.
    eau, eau_variance: (k,) float64, measured actuators; infinite variance where not measured.
    """

    points_mm: Array
    pixels: Array
    variance_px2: Array
    eau: Array
    eau_variance: Array


class FaceFilter:
    """The thesis' tracker state over time: `predict`, then `update`, once a frame.

    camera: picture size and first focal length.  pose: first pose.  eau: (k,) first actuators.
    point_count: n, number of points of every update, visible or not (5.2: no resizing).
    projection: `measurement_model.perspective`, or `lowe` there for the thesis' own (4.8-4.9).
    gate: residual after an update, in standard deviations, from which points are outliers.
    """

    def __init__(
        self,
        camera: Camera,
        pose: Pose,
        eau: Array,
        point_count: int,
        process_noise: ProcessNoise | None = None,
        uncertainty: InitialUncertainty | None = None,
        projection: Projection = perspective,
        gate: float = 3.5,
    ) -> None:
        self._camera = camera
        self._points, self._eaus = point_count, len(eau)
        self._noise = process_noise or ProcessNoise()
        self._projection, self._gate = projection, gate
        rigid = _RIGID + (6 if self._noise.velocities else 0)
        # Imported here, since the import takes most of a second and the default profile has no EKF.
        from filterpy.kalman import ExtendedKalmanFilter

        self._filter = ExtendedKalmanFilter(rigid + self._eaus, rigid + self._eaus)
        self._rotation, position = projection.state_from_pose(pose, camera.focal_px)
        self._filter.x = np.concatenate([position, np.zeros(3), [camera.focal_px]])
        self._filter.x = np.concatenate([self._filter.x, np.zeros(rigid - _RIGID), eau])
        self._filter.P = self._first_covariance(uncertainty or InitialUncertainty())
        self._inliers = np.zeros(point_count, dtype=np.bool_)
        self._normalised_innovation = 0.0

    @property
    def estimate(self) -> Estimate:
        """The state as the last `predict` or `update` left it."""
        x = self._filter.x
        pose = self._projection.pose_from_state(self._rotation, x[:3], float(x[6]))
        eau = x[len(x) - self._eaus :].copy()
        camera = replace(self._camera, focal_px=float(x[6]))
        return Estimate(pose, camera, eau, self._inliers, self._normalised_innovation)

    @property
    def covariance(self) -> Array:
        """(m, m) covariance of the state, in its order; read-only."""
        return np.asarray(self._filter.P)

    def predict(self, elapsed_s: float) -> Estimate:
        """Predict the state `elapsed_s` seconds later (4.2)."""
        if not elapsed_s > 0:
            raise ValueError(f"elapsed_s is {elapsed_s}, expected more than 0")
        self._filter.F = self._transition(elapsed_s)
        self._filter.Q = self._process_noise(elapsed_s)
        self._filter.predict()
        self._reset_error_state()
        return self.estimate

    def update(self, measured: Measurements) -> Estimate:
        """Correct the state by one frame's measurements (4.3).

        Raises ValueError where a shape is wrong.
        """
        self._check(measured)
        rotated = measured.points_mm @ matrix_from_quaternion(self._rotation).T
        expected, H = self._linearise(rotated)
        z = np.concatenate([(measured.pixels - self._camera.centre).ravel(), measured.eau])
        variance = np.concatenate([np.repeat(measured.variance_px2, 2), measured.eau_variance])
        is_measured = np.isfinite(variance) & np.isfinite(z)
        weight = np.where(is_measured, 1 / variance, 0.0)
        innovation = np.where(is_measured, z - expected, 0.0)
        self._reject_outliers(innovation, H, weight)
        y, H = self._reduced_measurements(innovation, H, weight)
        zero = np.zeros(len(y))
        self._filter.update(y, lambda _: H, lambda _: zero, R=np.eye(len(y)))
        if self._filter.x.shape != (self._filter.dim_x,):
            raise AssertionError(f"filterpy broadcast the state to {self._filter.x.shape}")
        self._reset_error_state()
        return self.estimate

    def _check(self, measured: Measurements) -> None:
        n, k = self._points, self._eaus
        shapes: tuple[tuple[int, ...], ...] = ((n, 3), (n, 2), (n,), (k,), (k,))
        for item, shape in zip(fields(measured), shapes, strict=True):
            array = getattr(measured, item.name)
            if array.shape != shape:
                raise ValueError(f"{item.name} has shape {array.shape}, expected {shape}")

    def _linearise(self, rotated_mm: Array) -> tuple[Array, Array]:
        """Expected measurement (2n + k,) and Jacobian (2n + k, m) at the present state (4.10)."""
        x, pixel_rows = self._filter.x, 2 * self._points
        pixels, J = self._projection.project(rotated_mm, x[:3], float(x[6]))
        H = np.zeros((pixel_rows + self._eaus, len(x)))
        H[:pixel_rows, :_RIGID] = J.reshape(pixel_rows, _RIGID)
        H[pixel_rows:, len(x) - self._eaus :] = np.eye(self._eaus)
        return np.concatenate([pixels.ravel(), x[len(x) - self._eaus :]]), H

    def _reject_outliers(self, innovation: Array, H: Array, weight: Array) -> None:
        """Set the weight of points to zero whose residual after a trial update is large.

        Residuals after the update, since an unpredicted motion of the head gives all points large
        innovations before it.
        """
        points, eaus = slice(0, 2 * self._points), slice(2 * self._points, None)
        visible: Mask = np.all(weight[points].reshape(-1, 2) > 0, axis=1)
        self._inliers = visible
        self._normalised_innovation = self._rms_innovation(innovation, H, weight, visible)
        if not visible.any():
            return
        weighted = H[eaus].T * weight[eaus]
        normal = np.linalg.inv(self._filter.P) + weighted @ H[eaus]
        right, rigid = weighted @ innovation[eaus], H[points, :_RIGID]
        residuals, scale = robust_residuals(
            normal, right, rigid, innovation[points], weight[points], visible
        )
        self._inliers = np.asarray(visible & (residuals < self._gate * scale))
        weight[points] *= np.repeat(self._inliers, 2)

    def _rms_innovation(self, innovation: Array, H: Array, weight: Array, visible: Mask) -> float:
        """Root mean square innovation of the visible points, in standard deviations."""
        rows = np.flatnonzero(np.repeat(visible, 2))
        if not len(rows):
            return 0.0
        expected = np.sum((H[rows] @ self._filter.P) * H[rows], axis=1)
        return float(np.sqrt(np.mean(innovation[rows] ** 2 / (expected + 1 / weight[rows]))))

    def _reduced_measurements(
        self, innovation: Array, H: Array, weight: Array
    ) -> tuple[Array, Array]:
        """Equivalent measurements of unit variance, as many as the state has entries.

        The update (a.6) depends on H, R and the innovation only by H' R^-1 H and H' R^-1 y.  The
        reduced number of rows makes its inverse small, and a weight of zero is exact.
        """
        # In standard deviations of the state, so that `_MIN_INFORMATION` has no unit.
        sigma = np.sqrt(np.diag(self._filter.P))
        J = H * sigma
        values, axes = np.linalg.eigh(J.T @ (weight[:, None] * J))
        root = np.sqrt(np.maximum(values, 0.0))
        informative = values > _MIN_INFORMATION * max(1.0, float(values[-1]))
        y = axes.T @ (J.T @ (weight * innovation))
        y = np.where(informative, y / np.where(informative, root, 1.0), 0.0)
        return y, np.where(informative, root, 0.0)[:, None] * axes.T / sigma

    def _reset_error_state(self) -> None:
        """Multiply the incremental rotation into the quaternion, and reset it (4.17-4.19)."""
        step = quaternion_from_vector(self._filter.x[3:6])
        self._rotation = normalise(multiply(step, self._rotation))
        self._filter.x[3:6] = 0.0

    def _transition(self, elapsed_s: float) -> Array:
        """The matrix A of (4.4)."""
        A = np.eye(len(self._filter.x))
        if self._noise.velocities:
            A[:6, _RIGID : _RIGID + 6] = elapsed_s * np.eye(6)
        return A

    def _process_noise(self, elapsed_s: float) -> Array:
        noise, x = self._noise, self._filter.x
        mm = np.array([x[6] / x[2], x[6] / x[2], 1.0])
        Q = np.zeros_like(self._filter.P)
        if noise.velocities:
            a = np.concatenate([noise.acceleration_mm_s2 * mm, [noise.acceleration_rad_s2] * 3])
            gain = np.zeros((len(x), 6))
            gain[:6] = np.diag(a * elapsed_s**2 / 2)
            gain[_RIGID : _RIGID + 6] = np.diag(a * elapsed_s)
            Q += gain @ gain.T
        else:
            speed = np.concatenate([noise.speed_mm_s * mm, [noise.speed_rad_s] * 3])
            Q[range(6), range(6)] = (speed * elapsed_s) ** 2
        Q[6, 6] = (noise.focal_per_s * x[6]) ** 2 * elapsed_s
        eaus = range(len(x) - self._eaus, len(x))
        Q[eaus, eaus] = (noise.eau_per_s * elapsed_s) ** 2
        return np.asarray(Q)

    def _first_covariance(self, uncertainty: InitialUncertainty) -> Array:
        x = self._filter.x
        pixel_per_mm = x[6] / x[2]
        sigma = np.full(len(x), uncertainty.eau)
        sigma[:_RIGID] = (
            [uncertainty.pixels] * 2
            + [uncertainty.depth_share * x[2]]
            + [uncertainty.rotation_rad] * 3
            + [0]
        )
        if self._noise.velocities:
            mm = np.array([pixel_per_mm, pixel_per_mm, 1.0])
            sigma[_RIGID : _RIGID + 3] = uncertainty.speed_mm_s * mm
            sigma[_RIGID + 3 : _RIGID + 6] = uncertainty.speed_rad_s
        P = np.diag(sigma**2)
        # Errors of the first focal length and of the first depth are proportional.
        joint = np.zeros(len(x))
        joint[[2, 6]] = uncertainty.focal_share * x[[2, 6]]
        return np.asarray(P + np.outer(joint, joint))
