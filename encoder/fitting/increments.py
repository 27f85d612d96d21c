"""Increments: how the step of a solver is added to a face, or to an identity with its faces.

Rotations are increments on their manifold: a rotation vector in camera axes, applied from the left.
"""

from dataclasses import replace

import numpy as np

from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.gauss_newton import Room
from runtime.jit import jit
from shared_model import geometry
from shared_model.animate import identity_from_controls
from shared_model.arrays import Array, Indices
from shared_model.mesh import Head
from shared_model.parameters import (
    AAUS,
    EAU_HIGH,
    EAU_LOW,
    EAUS,
    FaceParameters,
    Pose,
    clip_eau,
    with_focal_change,
)

RIGID = 6
FACE_PARAMETERS = RIGID + len(EAUS)


def step_limits(rotation_rad: float, translation_mm: float = np.inf, eau: float = np.inf) -> Array:
    """(6 + EAUs,) the largest size of each parameter's step."""
    limits = np.full(FACE_PARAMETERS, eau)
    limits[:3], limits[3:RIGID] = rotation_rad, translation_mm
    return limits


# Limits of fits to landmarks and of bundle adjustment, and of fits to one picture, whose gradients
# hold only near the current face.
STEP_LIMITS = step_limits(rotation_rad=0.5)
PICTURE_STEP_LIMITS = step_limits(rotation_rad=0.3, translation_mm=100.0, eau=1.0)
LOG_FOCAL_LIMIT, AAU_LIMIT = 0.2, 1.9
LOW, HIGH = np.array(EAU_LOW), np.array(EAU_HIGH)


def eau_room(eau: Array, active: Indices) -> Room:
    """How far active actuators may go down and up within their ranges.  eau: (EAUs,) of all."""
    return LOW[active] - eau[active], HIGH[active] - eau[active]


def actuator_room(face: FaceParameters, active: Indices, coefficients: int = 0) -> Room:
    """The same of each value of a solution, see `apply_picture_step`; the others go any way."""
    before, after = np.full(RIGID, np.inf), np.full(coefficients, np.inf)
    down, up = eau_room(face.eau, active)
    return np.concatenate([-before, down, -after]), np.concatenate([before, up, after])


def apply_increment(face: FaceParameters, step: Array) -> FaceParameters:
    """Add a step (6 + EAUs,): rotation (rad, camera axes), translation (mm), actuators."""
    rotation = _turned(face.pose.rotation, step)
    pose = Pose(rotation, face.pose.translation_mm + step[3:6])
    return replace(face, pose=pose, eau=clip_eau(face.eau + step[6:]))


@jit
def _turned(rotation: Array, turn: Array) -> Array:
    """A unit quaternion (4,), turned by a rotation vector, the first three values of `turn`: in a
    twentieth of the time of `multiply`, `quaternion_from_vector` and `normalise`."""
    angle = np.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    share = np.sin(angle / 2) / angle if angle > 0 else 0.5
    aw, ax, ay, az = np.cos(angle / 2), share * turn[0], share * turn[1], share * turn[2]
    bw, bx, by, bz = rotation[0], rotation[1], rotation[2], rotation[3]
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    length = np.sqrt(w * w + x * x + y * y + z * z)
    if w < 0:
        length = -length
    return np.array([w / length, x / length, y / length, z / length])


def apply_clipped_increment(
    face: FaceParameters, step: Array, limits: Array = STEP_LIMITS
) -> FaceParameters:
    """Add a step (6 + EAUs,), see `apply_increment`, clipped to `limits` (6 + EAUs,)."""
    return apply_increment(face, np.minimum(np.maximum(step, -limits), limits))


def apply_picture_step(face: FaceParameters, solution: Array, active: Indices) -> FaceParameters:
    """Add a solution (6 + a + m,): increments of pose and active actuators, then coefficients.

    The coefficients (m,) are values, since they enter the problem linearly.
    """
    size = RIGID + len(active)
    step = np.zeros(FACE_PARAMETERS)
    step[:RIGID] = solution[:RIGID]
    step[RIGID + active] = solution[RIGID:size]
    face = apply_clipped_increment(face, step, PICTURE_STEP_LIMITS)
    return replace(face, modes=solution[size:])


def shared_parameter_count(fitted: IdentityFit) -> int:
    """Number of parameters that all frames of a person share: log f, AAUs, controls."""
    return 1 + len(AAUS) + fitted.control_mm.size


def identity_room(fitted: IdentityFit) -> Room:
    """How far each value of a step may go down and up, see `apply_identity_increment`."""
    limits, aau = STEP_LIMITS[:RIGID], fitted.identity.aau
    focal, control = np.array([LOG_FOCAL_LIMIT]), np.full(fitted.control_mm.size, np.inf)
    down, up = [-focal, -AAU_LIMIT - aau, -control], [focal, AAU_LIMIT - aau, control]
    for face in fitted.frames:
        down += [-limits, LOW - face.eau]
        up += [limits, HIGH - face.eau]
    return np.concatenate(down), np.concatenate(up)


def apply_identity_increment(head: Head, fitted: IdentityFit, step: Array) -> IdentityFit:
    """Add a step over log f, AAUs, x, y, z of each control, then w, t, EAUs of each frame.

    Depths change in proportion to the focal length, so that faces keep their size.
    """
    n, shared = len(AAUS), shared_parameter_count(fitted)
    log_ratio = np.clip(step[0], -LOG_FOCAL_LIMIT, LOG_FOCAL_LIMIT)
    focal_px = fitted.camera.focal_px * float(np.exp(log_ratio))
    ratio = focal_px / fitted.camera.focal_px
    aau = np.clip(fitted.identity.aau + step[1 : 1 + n], -AAU_LIMIT, AAU_LIMIT)
    control = fitted.control_mm + step[1 + n : shared].reshape(-1, 3)
    steps = step[shared:].reshape(len(fitted.frames), -1)
    return replace(
        fitted,
        camera=replace(fitted.camera, focal_px=focal_px),
        identity=identity_from_controls(head, aau, control),
        control_mm=control,
        frames=tuple(
            apply_clipped_increment(with_focal_change(face, ratio), each)
            for face, each in zip(fitted.frames, steps, strict=True)
        ),
    )


def identity_increment_between(origin: IdentityFit, fitted: IdentityFit) -> Array:
    """The step from `origin` to `fitted` and its first face, see `apply_identity_increment`."""
    ratio = fitted.camera.focal_px / origin.camera.focal_px
    here, there = fitted.frames[0], origin.frames[0]
    turn = geometry.multiply(here.pose.rotation, geometry.conjugate(there.pose.rotation))
    shift = here.pose.translation_mm - there.pose.translation_mm * [1.0, 1.0, ratio]
    return np.concatenate(
        [
            [np.log(ratio)],
            fitted.identity.aau - origin.identity.aau,
            (fitted.control_mm - origin.control_mm).ravel(),
            geometry.vector_from_quaternion(turn),
            shift,
            here.eau - there.eau,
        ]
    )
