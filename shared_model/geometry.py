"""Rotations, pose and camera.  The one place that states the coordinate conventions.

Head frame: origin midway between the tragions, Frankfurt plane horizontal; x to the subject's left,
y up, z out of the face; millimetres.
Camera frame: OpenCV's; x right, y down, z forward; millimetres.
Pixels: u right, v down; pixel (0, 0) has its *centre* at (0, 0); the principal point is the
picture's middle, ((width - 1) / 2, (height - 1) / 2); one focal length in pixels (eq. 4.6).
Rotations: unit quaternions (w, x, y, z); small rotations: axis-angle vectors in the camera frame.

A face that looks straight into the camera has `FRONTAL` rotation: head x (the subject's left) is
the picture's right, head y is the picture's up, head z points at the camera.
"""

from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array
from shared_model.parameters import FaceParameters, Pose

# Half a turn about x: (x, y, z) -> (x, -y, -z), head axes to camera axes of a frontal face.
FRONTAL: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera with square pixels: picture size and focal length, pixels."""

    width: int
    height: int
    focal_px: float

    @property
    def centre(self) -> Array:
        """(2,) principal point, pixels."""
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])


def normalise(q: Array) -> Array:
    """Scale quaternions (..., 4) to unit length, w >= 0."""
    q = np.asarray(q, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (..., 4): rotate by `b`, then by `a`.

    a, b: of equal shape, or one of them (4,).
    """
    aw, ax, ay, az = np.asarray(a, dtype=np.float64).T
    bw, bx, by, bz = np.asarray(b, dtype=np.float64).T
    product = [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
    return np.ascontiguousarray(np.array(product).T)


def conjugate(q: Array) -> Array:
    """The inverse rotation of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(q, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0]))


def quaternion_from_vector(w: Array) -> Array:
    """Unit quaternions (..., 4) of axis-angle vectors (..., 3), radians: eq. 4.17, exactly."""
    w = np.asarray(w, dtype=np.float64)
    half = np.linalg.norm(w, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), w / 2 * np.sinc(half / np.pi)], axis=-1)


def vector_from_quaternion(q: Array) -> Array:
    """Axis-angle vectors (..., 3), radians, of unit quaternions (..., 4); angle at most pi."""
    q = normalise(q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-12), 2.0)
    return np.asarray(q[..., 1:] * scale)


def matrix_from_quaternion(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4), eq. 4.19."""
    w, x, y, z = np.asarray(q, dtype=np.float64).T
    columns = [
        [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z],
    ]
    return np.ascontiguousarray(np.array(columns).T)


def rotation_angle_deg(rotation: Array) -> float:
    """The angle by which a rotation matrix (3, 3) turns, 0 to 180 degrees."""
    cosine = (np.trace(rotation) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def quaternion_from_matrix(matrix: Array) -> Array:
    """Unit quaternion (4,) of a rotation matrix (3, 3), w >= 0."""
    m = np.asarray(matrix, dtype=np.float64)
    # The eigenvector of Bar-Itzhack's symmetric matrix: no case analysis, best fit if m is noisy.
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0, 0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0, 0, 0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    return normalise(np.linalg.eigh(k, UPLO="U")[1][:, -1])


def camera_from_head(pose: Pose, points_mm: Array) -> Array:
    """Move (..., 3) points, mm, from the head frame to the camera frame (eq. 4.5)."""
    return np.asarray(points_mm @ matrix_from_quaternion(pose.rotation).T + pose.translation_mm)


def pixel_from_camera(camera: Camera, points_mm: Array) -> Array:
    """Project (..., 3) camera-frame points, mm, to (..., 2) pixels (eq. 4.6)."""
    return np.asarray(camera.focal_px * points_mm[..., :2] / points_mm[..., 2:] + camera.centre)


def pixel_from_head(camera: Camera, pose: Pose, points_mm: Array) -> Array:
    """Project (..., 3) head-frame points, mm, to (..., 2) pixels."""
    return pixel_from_camera(camera, camera_from_head(pose, points_mm))


def euler_deg(pose: Pose) -> tuple[float, float, float]:
    """Pitch, yaw, roll of the head, degrees, R = R_pitch R_yaw R_roll (eq. 2.14) after `FRONTAL`.

    Pitch > 0 looks up, yaw > 0 turns to the subject's left, roll > 0 tilts the head to the
    subject's right, all in head axes.
    """
    r = matrix_from_quaternion(multiply(conjugate(np.array(FRONTAL)), pose.rotation))
    pitch = -np.arctan2(-r[1, 2], r[2, 2])
    yaw = np.arcsin(np.clip(r[0, 2], -1, 1))
    roll = np.arctan2(-r[0, 1], r[0, 0])
    return float(np.degrees(pitch)), float(np.degrees(yaw)), float(np.degrees(roll))


def pose_from_euler(
    pitch_deg: float, yaw_deg: float, roll_deg: float, translation_mm: Array
) -> Pose:
    """The pose with these angles (see `euler_deg`) and translation (3,), mm, camera frame."""
    angles = np.radians([-pitch_deg, yaw_deg, roll_deg])
    pitch, yaw, roll = quaternion_from_vector(np.diag(angles))
    turned = multiply(np.array(FRONTAL), multiply(pitch, multiply(yaw, roll)))
    return Pose(normalise(turned), np.asarray(translation_mm, dtype=np.float64))


def interpolate(first: FaceParameters, second: FaceParameters, fraction: float) -> FaceParameters:
    """The face `fraction` (0..1) of the way from `first` to `second`.

    Rotation goes along the shortest arc, all other parameters linearly.  If the numbers of
    coefficients of modes or layers differ, as at a model update, they are those of `second`.
    """
    turn = vector_from_quaternion(multiply(second.pose.rotation, conjugate(first.pose.rotation)))
    rotation = multiply(quaternion_from_vector(fraction * turn), first.pose.rotation)
    translation_mm = _mix(first.pose.translation_mm, second.pose.translation_mm, fraction)
    return FaceParameters(
        Pose(normalise(rotation), translation_mm),
        _mix(first.eau, second.eau, fraction),
        _mix_if_same(first.modes, second.modes, fraction),
        _mix_if_same(first.layers, second.layers, fraction),
    )


def _mix_if_same(first: Array, second: Array, fraction: float) -> Array:
    return _mix(first, second, fraction) if first.shape == second.shape else second


def _mix(first: Array, second: Array, fraction: float) -> Array:
    return np.asarray(first + fraction * (second - first))
