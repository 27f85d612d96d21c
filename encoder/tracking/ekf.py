"""Extended Kalman Filter over pose, focal length and actuators (thesis 4.3 and A.2), on filterpy.

The state is s = (t_x, t_y, t_z, w_x, w_y, w_z, f, [their six velocities], a_1 .. a_k) (4.1):
t_x, t_y are where the head's origin lies in the picture, pixels from the principal point; t_z its
depth, mm; w a small rotation against a quaternion kept beside the state, radians, camera frame; f
the focal length, pixels; a the actuators, measured directly (4.16).  After every step w is folded
into the quaternion (4.17-4.19) and is zero again, so that the Jacobian of Table 4.1 is exact.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from encoder.tracking.measurement_model import Projection, perspective
from encoder.tracking.outlier_rejection import robust_residuals
from shared_model.geometry import (
    Camera,
    matrix_from_quaternion,
    multiply,
    normalise,
    quaternion_from_vector,
)
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_RIGID = 7
# Directions of the state that measurements say this little about, against what is known, are left.
_NOTHING = 1e-12


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """How heads and faces move: the filter's process noise, as standard deviations.

    velocities: True is the constant-velocity model (4.4), False the thesis' simplified vector.
    acceleration_mm_s2, acceleration_rad_s2: what changes the velocities.
    speed_mm_s, speed_rad_s: how fast the head drifts in the simplified vector.
    eau_per_s: how fast actuators drift.
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
    """How far off the first state may be, as standard deviations."""

    pixels: float = 3.0
    depth_share: float = 0.03
    turn_rad: float = 0.06
    focal_share: float = 0.1
    speed_mm_s: float = 200.0
    speed_rad_s: float = 1.0
    eau: float = 0.3


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the filter holds for true.

    pose: the head against the camera.
    camera: with the focal length that goes with that pose; no other projects it right.
    eau: (k,) float64, the filtered actuators.
    used: (n,) bool, which points counted in the last update.
    distance: root mean square of the visible points' innovations in standard deviations, before
        gating; at most about 1 where the face moves as foreseen, large where it jumps or is lost.
    """

    pose: Pose
    camera: Camera
    eau: Array
    inliers: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    normalised_innovation: float = 0.0


class FaceFilter:
    """The thesis' tracker state over time: `predict`, then `update`, once a frame.

    camera: picture size and first focal length.  pose: first pose.  eau: (k,) first actuators.
    point_count: n, how many points every update brings, seen or not (5.2: no resizing).
    projection: `projection.perspective`, or `projection.lowe` for the thesis' own (4.8-4.9).
    gate: points that stay so many standard deviations off their pixels are gross errors.
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
        self._motion, self._projection, self._gate = (
            process_noise or ProcessNoise(),
            projection,
            gate,
        )
        rigid = _RIGID + (6 if self._motion.velocities else 0)
        # Takes most of a second to import, which calls of the default profile need not wait for.
        from filterpy.kalman import ExtendedKalmanFilter

        self._filter = ExtendedKalmanFilter(rigid + self._eaus, rigid + self._eaus)
        self._rotation, position = projection.state_from_pose(pose, camera.focal_px)
        self._filter.x = np.concatenate([position, np.zeros(3), [camera.focal_px]])
        self._filter.x = np.concatenate([self._filter.x, np.zeros(rigid - _RIGID), eau])
        self._filter.P = self._first_covariance(uncertainty or InitialUncertainty())
        self._used = np.zeros(point_count, dtype=np.bool_)
        self._distance = 0.0

    @property
    def estimate(self) -> Estimate:
        """The state as the last `predict` or `update` left it."""
        x = self._filter.x
        pose = self._projection.pose_from_state(self._rotation, x[:3], float(x[6]))
        eau = x[len(x) - self._eaus :].copy()
        camera = replace(self._camera, focal_px=float(x[6]))
        return Estimate(pose, camera, eau, self._used, self._distance)

    @property
    def covariance(self) -> Array:
        """(m, m) covariance of the state, in its order; to be read, not written."""
        return np.asarray(self._filter.P)

    def predict(self, elapsed_s: float) -> Estimate:
        """Carry the state `elapsed_s` seconds on (4.2): where the face should be now."""
        if not elapsed_s > 0:
            raise ValueError(f"elapsed_s is {elapsed_s}, expected more than 0")
        self._filter.F = self._transition(elapsed_s)
        self._filter.Q = self._process_noise(elapsed_s)
        self._filter.predict()
        self._fold_rotation()
        return self.estimate

    def update(
        self,
        points_mm: Array,
        pixels: Array,
        variance_px2: Array,
        eau: Array,
        eau_variance: Array,
    ) -> Estimate:
        """Correct the state by one frame's measurements (4.3).

        points_mm: (n, 3) float64, mm, head frame, as the present expression has them.
        pixels: (n, 2) float64 where they were seen; anything, also NaN, where variance is infinite.
        variance_px2: (n,) float64, px^2; infinite for points that are occluded or not known.
        eau, eau_variance: (k,) float64, the fitted actuators; infinite variance where not measured.
        Raises ValueError where a shape is wrong.
        """
        self._check(points_mm, pixels, variance_px2, eau, eau_variance)
        turned = points_mm @ matrix_from_quaternion(self._rotation).T
        expected, H = self._linearise(turned)
        z = np.concatenate([(pixels - self._camera.centre).ravel(), eau])
        variance = np.concatenate([np.repeat(variance_px2, 2), eau_variance])
        seen = np.isfinite(variance) & np.isfinite(z)
        weight = np.where(seen, 1 / variance, 0.0)
        innovation = np.where(seen, z - expected, 0.0)
        self._gate_out(innovation, H, weight)
        y, H = self._compress(innovation, H, weight)
        still = np.zeros(len(y))
        self._filter.update(y, lambda _: H, lambda _: still, R=np.eye(len(y)))
        if self._filter.x.shape != (self._filter.dim_x,):
            raise AssertionError(f"filterpy broadcast the state to {self._filter.x.shape}")
        self._fold_rotation()
        return self.estimate

    def _check(self, *arrays: Array) -> None:
        names = ("points_mm", "pixels", "variance_px2", "eau", "eau_variance")
        n, k = self._points, self._eaus
        shapes: tuple[tuple[int, ...], ...] = ((n, 3), (n, 2), (n,), (k,), (k,))
        for name, array, shape in zip(names, arrays, shapes, strict=True):
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected {shape}")

    def _linearise(self, turned_mm: Array) -> tuple[Array, Array]:
        """Expected measurement (2n + k,) and Jacobian (2n + k, m) at the present state (4.10)."""
        x, pixel_rows = self._filter.x, 2 * self._points
        pixels, J = self._projection.project(turned_mm, x[:3], float(x[6]))
        H = np.zeros((pixel_rows + self._eaus, len(x)))
        H[:pixel_rows, :_RIGID] = J.reshape(pixel_rows, _RIGID)
        H[pixel_rows:, len(x) - self._eaus :] = np.eye(self._eaus)
        return np.concatenate([pixels.ravel(), x[len(x) - self._eaus :]]), H

    def _gate_out(self, innovation: Array, H: Array, weight: Array) -> None:
        """Take the weight from gross outliers: what trial updates leave far off its pixel.

        After an update and not before it, since a head that moves unforeseen takes all points
        along.
        """
        points, eaus = slice(0, 2 * self._points), slice(2 * self._points, None)
        visible: Mask = np.all(weight[points].reshape(-1, 2) > 0, axis=1)
        self._used, self._distance = visible, self._surprise(innovation, H, weight, visible)
        if not visible.any():
            return
        weighted = H[eaus].T * weight[eaus]
        known = np.linalg.inv(self._filter.P) + weighted @ H[eaus]
        towards, rigid = weighted @ innovation[eaus], H[points, :_RIGID]
        off, crowd = robust_residuals(
            known, towards, rigid, innovation[points], weight[points], visible
        )
        self._used = np.asarray(visible & (off < self._gate * crowd))
        weight[points] *= np.repeat(self._used, 2)

    def _surprise(self, innovation: Array, H: Array, weight: Array, visible: Mask) -> float:
        """Root mean square innovation of the visible points in its own standard deviations."""
        rows = np.flatnonzero(np.repeat(visible, 2))
        if not len(rows):
            return 0.0
        expected = np.sum((H[rows] @ self._filter.P) * H[rows], axis=1)
        return float(np.sqrt(np.mean(innovation[rows] ** 2 / (expected + 1 / weight[rows]))))

    def _compress(self, innovation: Array, H: Array, weight: Array) -> tuple[Array, Array]:
        """As many measurements as the state has entries, of unit variance, that say the same.

        The update (a.6) needs of H, R and the innovation only H' R^-1 H and H' R^-1 y; so few rows
        keep its inverse small, and weight zero is truly infinite variance.
        """
        # In units of what is known, so that what is negligible is so in every direction.
        known = np.sqrt(np.diag(self._filter.P))
        J = H * known
        values, axes = np.linalg.eigh(J.T @ (weight[:, None] * J))
        root = np.sqrt(np.maximum(values, 0.0))
        told = values > _NOTHING * max(1.0, float(values[-1]))
        y = axes.T @ (J.T @ (weight * innovation))
        y = np.where(told, y / np.where(told, root, 1.0), 0.0)
        return y, np.where(told, root, 0.0)[:, None] * axes.T / known

    def _fold_rotation(self) -> None:
        """Move the incremental rotation into the quaternion (4.17-4.19)."""
        step = quaternion_from_vector(self._filter.x[3:6])
        self._rotation = normalise(multiply(step, self._rotation))
        self._filter.x[3:6] = 0.0

    def _transition(self, elapsed_s: float) -> Array:
        """The matrix A of (4.4)."""
        A = np.eye(len(self._filter.x))
        if self._motion.velocities:
            A[:6, _RIGID : _RIGID + 6] = elapsed_s * np.eye(6)
        return A

    def _process_noise(self, elapsed_s: float) -> Array:
        motion, x = self._motion, self._filter.x
        mm = np.array([x[6] / x[2], x[6] / x[2], 1.0])
        Q = np.zeros_like(self._filter.P)
        if motion.velocities:
            a = np.concatenate([motion.acceleration_mm_s2 * mm, [motion.acceleration_rad_s2] * 3])
            gain = np.zeros((len(x), 6))
            gain[:6] = np.diag(a * elapsed_s**2 / 2)
            gain[_RIGID : _RIGID + 6] = np.diag(a * elapsed_s)
            Q += gain @ gain.T
        else:
            speed = np.concatenate([motion.speed_mm_s * mm, [motion.speed_rad_s] * 3])
            Q[range(6), range(6)] = (speed * elapsed_s) ** 2
        Q[6, 6] = (motion.focal_per_s * x[6]) ** 2 * elapsed_s
        eaus = range(len(x) - self._eaus, len(x))
        Q[eaus, eaus] = (motion.eau_per_s * elapsed_s) ** 2
        return np.asarray(Q)

    def _first_covariance(self, doubt: InitialUncertainty) -> Array:
        x = self._filter.x
        pixel_per_mm = x[6] / x[2]
        sigma = np.full(len(x), doubt.eau)
        sigma[:_RIGID] = (
            [doubt.pixels] * 2 + [doubt.depth_share * x[2]] + [doubt.turn_rad] * 3 + [0]
        )
        if self._motion.velocities:
            mm = np.array([pixel_per_mm, pixel_per_mm, 1.0])
            sigma[_RIGID : _RIGID + 3] = doubt.speed_mm_s * mm
            sigma[_RIGID + 3 : _RIGID + 6] = doubt.speed_rad_s
        P = np.diag(sigma**2)
        # A wrong first focal length came with a depth wrong by the same share.
        both = np.zeros(len(x))
        both[[2, 6]] = doubt.focal_share * x[[2, 6]]
        return np.asarray(P + np.outer(both, both))
