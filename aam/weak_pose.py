"""Poses under weak perspective (thesis eq. 2.16) as vectors that searches displace.

A pose is (wx, wy, wz, x, y, log s): the rotation vector that turns the head before it looks into
the camera, `FRONTAL` exp(w), radians; the pixel of the head's origin; the logarithm of the scale,
pixels per mm.  A step is (wx, wy, wz, x, y, log s) too, but in the head's own axes, so that the
same step changes a texture alike wherever the face is: the rotation is applied in head axes, the
shift is along and across the head's horizontal axis in the picture, in mm.  Steps turn and scale
about the middle of the face: about the head's origin, between the ears, a turn would be a shift of
the face before anything else.
"""

import numpy as np

from shared_model.arrays import Array
from shared_model.geometry import (
    FRONTAL,
    Camera,
    conjugate,
    euler_deg,
    matrix_from_quaternion,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import Pose

POSE_COUNT = 6
POSE_NAMES = ("rx", "ry", "rz", "tx", "ty", "scale")
# The lens by which weak perspective is expressed as a perspective camera, in terms of the longer
# side: so long that depth in the head changes the scale by less than 1 in 10,000.
TELEPHOTO_RATIO = 1000.0
# What stays in its place when a step turns or scales, head frame.
PIVOT_MM = np.array([0.0, -18.0, 75.0])


def rotation_matrix(pose: Array) -> Array:
    """(3, 3) camera from head.  pose: (6,)."""
    turned = multiply(np.array(FRONTAL), quaternion_from_vector(pose[:3]))
    return matrix_from_quaternion(turned)


def project(pose: Array, points_mm: Array) -> Array:
    """(m, 2) pixels of points (m, 3), mm, head frame (eq. 2.16)."""
    rotation = rotation_matrix(pose)
    return np.asarray(np.exp(pose[5]) * (points_mm @ rotation[:2].T) + pose[3:5])


def displaced(pose: Array, step: Array) -> Array:
    """The pose (6,) after a step (6,), see above."""
    turn = multiply(quaternion_from_vector(pose[:3]), quaternion_from_vector(step[:3]))
    turned = np.concatenate([vector_from_quaternion(turn), pose[3:]])
    across, down = _face_axes(pose)
    shift = np.exp(pose[5]) * (step[3] * across + step[4] * down)
    place = _pivot(pose) + shift
    scale = pose[5] + step[5]
    turned[3:] = [0.0, 0.0, scale]
    return np.concatenate([turned[:3], place - _pivot(turned), [scale]])


def step_between(pose: Array, target: Array) -> Array:
    """The step (6,) that takes one pose to another: `displaced(pose, step)` is the target."""
    turn = multiply(conjugate(quaternion_from_vector(pose[:3])), quaternion_from_vector(target[:3]))
    across, down = _face_axes(pose)
    shift = (_pivot(target) - _pivot(pose)) / np.exp(pose[5])
    moved = [shift @ across, shift @ down, target[5] - pose[5]]
    return np.concatenate([vector_from_quaternion(turn), moved])


def _pivot(pose: Array) -> Array:
    """(2,) pixel of the middle of the face."""
    return np.asarray(project(pose, PIVOT_MM[None])[0])


def _face_axes(pose: Array) -> tuple[Array, Array]:
    """(2,) each: along the head's horizontal axis in the picture, and across it, downwards."""
    across = rotation_matrix(pose)[:2, 0]
    across = across / max(float(np.linalg.norm(across)), 1e-6)
    return across, np.array([-across[1], across[0]])


def mirrored(pose: Array, width: int) -> Array:
    """The pose (6,) of the same face in the mirror image of a picture of this width, pixels."""
    flipped = pose * [1, -1, -1, 1, 1, 1]
    flipped[3] = width - 1 - pose[3]
    return np.asarray(flipped)


def pose_vector(pose: Pose, camera: Camera) -> Array:
    """The weak-perspective vector (6,) of a perspective pose, exact at the head's origin."""
    turn = multiply(conjugate(np.array(FRONTAL)), pose.rotation)
    scale = camera.focal_px / pose.translation_mm[2]
    origin = camera.centre + scale * pose.translation_mm[:2]
    return np.concatenate([vector_from_quaternion(turn), origin, [np.log(scale)]])


def pose_vector_at(pose: Pose, camera: Camera, point_mm: Array = PIVOT_MM) -> Array:
    """The weak-perspective vector (6,) of a perspective pose, exact at a point (3,) of the head.

    The head is turned as it is seen along the line of sight to that point.
    """
    place = matrix_from_quaternion(pose.rotation) @ point_mm + pose.translation_mm
    sight, axis = place / np.linalg.norm(place), np.array([0.0, 0.0, 1.0])
    across = np.cross(sight, axis)
    sine = float(np.linalg.norm(across))
    turn = across * (np.arcsin(min(sine, 1.0)) / sine if sine > 1e-9 else 1.0)
    seen = normalise(multiply(quaternion_from_vector(turn), pose.rotation))
    rotation = vector_from_quaternion(multiply(conjugate(np.array(FRONTAL)), seen))
    scale = camera.focal_px / place[2]
    vector = np.concatenate([rotation, np.zeros(2), [np.log(scale)]])
    vector[3:5] = camera.centre + scale * place[:2] - project(vector, point_mm[None])[0]
    return vector


def telephoto(pose: Array, size: tuple[int, int]) -> tuple[Camera, Pose]:
    """A perspective camera and pose that project as the vector (6,) does.

    size: (width, height) of the picture.
    """
    camera = Camera(*size, TELEPHOTO_RATIO * max(size))
    return camera, perspective_pose(pose, camera)


def perspective_pose(pose: Array, camera: Camera) -> Pose:
    """The pose before a camera that a vector (6,) means: the inverse of `pose_vector`."""
    scale = np.exp(pose[5])
    shift = (pose[3:5] - camera.centre) / scale
    rotation = normalise(multiply(np.array(FRONTAL), quaternion_from_vector(pose[:3])))
    return Pose(rotation, np.append(shift, camera.focal_px / scale))


def euler_angles_deg(pose: Array) -> tuple[float, float, float]:
    """Pitch, yaw, roll, degrees, see `euler_deg`."""
    rotation = normalise(multiply(np.array(FRONTAL), quaternion_from_vector(pose[:3])))
    return euler_deg(Pose(rotation, np.zeros(3)))
