"""Projections of head points by the filter's state, with derivatives (Tables 4.1 and 4.2).

Both projections take the head's origin at (t_x, t_y), pixels from the principal point, and depth
t_z, mm, and points in the camera's axes before the translation, p = R P (4.8).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array
from shared_model.geometry import conjugate, multiply, normalise, quaternion_from_vector
from shared_model.parameters import Pose


@dataclass(frozen=True, slots=True)
class Projection:
    """A measurement model of the filter.

    project: (rotated_mm (n, 3), position (3,), focal_px) -> pixels (n, 2) from the principal point
        and their derivatives (n, 2, 7) with respect to t_x, t_y, t_z, w_x, w_y, w_z, f at w = 0.
    state_from_pose: (pose, focal_px) -> rotation quaternion (4,) and position (3,).
    pose_from_state: (rotation, position, focal_px) -> pose.
    """

    project: Callable[[Array, Array, float], tuple[Array, Array]]
    state_from_pose: Callable[[Pose, float], tuple[Array, Array]]
    pose_from_state: Callable[[Array, Array, float], Pose]


def _rotation_derivatives(rotated_mm: Array) -> Array:
    """(n, 3, 3) derivatives of rotated points (axis 1) by small rotations (axis 2), Table 4.1."""
    x, y, z = rotated_mm.T
    zero = np.zeros_like(x)
    rows = [[zero, z, -y], [-z, zero, x], [y, -x, zero]]
    return np.array(rows).transpose(2, 0, 1)


def _project_perspective(
    rotated_mm: Array, position: Array, focal_px: float
) -> tuple[Array, Array]:
    """The pinhole camera (4.6) with t_x, t_y = f T_x / T_z, f T_y / T_z."""
    t_xy, t_z = position[:2], float(position[2])
    flat, depth = rotated_mm[:, :2], rotated_mm[:, 2:]
    d = 1 / (depth + t_z)
    pixels = d * (focal_px * flat + t_xy * t_z)
    rotation = _rotation_derivatives(rotated_mm)
    J = np.zeros((len(rotated_mm), 2, 7))
    J[:, 0, 0] = J[:, 1, 1] = t_z * d[:, 0]
    J[:, :, 2] = d**2 * (t_xy * depth - focal_px * flat)
    J[:, :, 3:6] = d[:, :, None] * (
        focal_px * rotation[:, :2] - pixels[:, :, None] * rotation[:, 2:]
    )
    J[:, :, 6] = d * flat
    return pixels, J


def _project_lowe(rotated_mm: Array, position: Array, focal_px: float) -> tuple[Array, Array]:
    """Lowe's projection (4.9) and its derivatives, Table 4.2."""
    flat, d = rotated_mm[:, :2], 1 / (rotated_mm[:, 2:] + position[2])
    centred = focal_px * d * flat
    rotation = _rotation_derivatives(rotated_mm)
    J = np.zeros((len(rotated_mm), 2, 7))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, :, 2] = -d * centred
    J[:, :, 3:6] = d[:, :, None] * (
        focal_px * rotation[:, :2] - centred[:, :, None] * rotation[:, 2:]
    )
    J[:, :, 6] = d * flat
    return centred + position[:2], J


def _perspective_from_pose(pose: Pose, focal_px: float) -> tuple[Array, Array]:
    x, y, z = pose.translation_mm
    return pose.rotation, np.array([focal_px * x / z, focal_px * y / z, z])


def _pose_from_perspective(rotation: Array, position: Array, focal_px: float) -> Pose:
    ray = np.array([position[0] / focal_px, position[1] / focal_px, 1.0])
    return Pose(rotation, position[2] * ray)


def _ray_rotation(ray: Array) -> tuple[Array, float]:
    """The shortest rotation from the optical axis to `ray` (3,), and its angle's cosine."""
    unit = ray / np.linalg.norm(ray)
    cosine = float(unit[2])
    axis = np.array([-unit[1], unit[0], 0.0])
    sine = float(np.linalg.norm(axis))
    vector = axis / sine * np.arctan2(sine, cosine) if sine > 1e-12 else axis
    return quaternion_from_vector(vector), cosine


def _lowe_from_pose(pose: Pose, focal_px: float) -> tuple[Array, Array]:
    """The optical axis of Lowe's camera points at the head, which therefore rotates with the ray.

    Both projections then agree to first order at the head.  Off the optical axis, a pinhole camera
    also stretches along the ray by 1 / cos.  Lowe's projection cannot express this; the mean of the
    stretch over directions goes into the depth.
    """
    axis_from_ray, cosine = _ray_rotation(pose.translation_mm)
    rotation = normalise(multiply(conjugate(axis_from_ray), pose.rotation))
    _, position = _perspective_from_pose(pose, focal_px)
    return rotation, position * [1.0, 1.0, np.sqrt(cosine)]


def _pose_from_lowe(rotation: Array, position: Array, focal_px: float) -> Pose:
    pose = _pose_from_perspective(rotation, position, focal_px)
    axis_from_ray, cosine = _ray_rotation(pose.translation_mm)
    corrected = normalise(multiply(axis_from_ray, rotation))
    return Pose(corrected, pose.translation_mm / np.sqrt(cosine))


perspective = Projection(_project_perspective, _perspective_from_pose, _pose_from_perspective)
lowe = Projection(_project_lowe, _lowe_from_pose, _pose_from_lowe)
PROJECTIONS: Mapping[str, Projection] = {"perspective": perspective, "lowe": lowe}
