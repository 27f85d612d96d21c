"""Who is in the picture, from landmarks: identity and focal length, by regularised least squares.

One frame gives a first identity; several frames at different yaw, solved together, see depth that
one frame cannot.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.increments import apply_identity_increment, shared_parameter_count
from encoder.fitting.landmark_fit import (
    EAU_PRIOR_SIGMA,
    LANDMARK_SIGMA,
    LandmarkModel,
    initial_parameters,
    landmark_model,
    observed_points,
    personalise,
    projection_jacobian,
    rotate_fields,
    rotated_points,
)
from encoder.fitting.lip_closure import lip_closure_constraints
from shared_model import geometry
from shared_model.animate import identity_from_controls
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import AAUS, BROW_EAUS, EAUS, FaceParameters

Array = NDArray[np.float64]

# Standard deviations of the priors, and of the network's depths in units of the eyes' distance.
DEPTH_SIGMA = 0.08
AAU_SIGMA = 0.5
# Of actuators that never move, and of brows where an identity is for few actuators: one frame's
# raised brows may as well be high ones.
INACTIVE_EAU_SIGMA = 1e-3
BROWS_SIGMA = 0.05
RESIDUAL_SIGMA_MM = 2.0
RESIDUAL_DEPTH_SIGMA_MM = 1.2
# Of the logarithm of the focal length about that of a typical lens.
LOG_FOCAL_PRIOR_SIGMA = 0.15
# How many times an identity is improved, from the usual one or one that is near.
STEPS, STEPS_NEAR = 12, 4
TYPICAL_FOCAL = 1.3  # of the picture's longer side: a webcam or a portrait lens


def fit_identity(
    head: Head,
    size: tuple[int, int],
    landmarks: Sequence[Array],
    active: Sequence[int] | None = None,
    initial: IdentityFit | None = None,
) -> IdentityFit:
    """Identity and focal length that explain all frames, with pose and actuators of each.

    size: (width, height) of the picture.  landmarks: one (468, 3) array a frame, pixels (z too).
    active: the only actuators that will ever move.  The others then stay at rest, the brows nearly
        so, and the lips meet there, so that these alone can close a mouth that is open in the
        frames.  None: all.
    near: an identity that other frames of the same caller gave, if there is one; the way is shorter
        from there.
    """
    eau_sigma = _expected_eau(active)
    model = landmark_model(head)
    if initial is None:
        control = np.zeros((len(model.residual), 3))
        identity = identity_from_controls(head, np.zeros(len(AAUS)), control)
        camera, first = Camera(*size, TYPICAL_FOCAL * max(size)), model
    else:
        control, identity, camera = initial.control_mm, initial.identity, initial.camera
        first = personalise(model, identity.aau, control)
    frames = tuple(initial_parameters(first, camera, points) for points in landmarks)
    found = IdentityFit(camera, identity, control, frames)
    for _ in range(STEPS_NEAR if initial else STEPS):
        personal = personalise(model, found.identity.aau, found.control_mm)
        lips = None
        if active is not None:
            lips = lip_closure_constraints(
                model.index, personal.neutral, model.neutral, model.aau, model.residual
            )
        normal, gradient = _joint_equations(personal, found, landmarks, eau_sigma, lips)
        step = np.asarray(np.linalg.solve(normal, gradient), float)
        found = apply_identity_increment(head, found, step)
    return replace(found, information=normal if len(frames) == 1 else None)


def _expected_eau(active: Sequence[int] | None) -> Array:
    """(EAUs,) how far actuators are from rest in the frames that show who it is."""
    if active is None:
        return np.full(len(EAUS), EAU_PRIOR_SIGMA)
    sigma = np.full(len(EAUS), INACTIVE_EAU_SIGMA)
    for index in active:
        sigma[index] = BROWS_SIGMA if EAUS[index].name in BROW_EAUS else EAU_PRIOR_SIGMA
    return sigma


def _joint_equations(
    model: LandmarkModel,
    fitted: IdentityFit,
    landmarks: Sequence[Array],
    eau_sigma: Array,
    lips: tuple[Array, Array] | None,
) -> tuple[Array, Array]:
    """Normal matrix and right side of a Gauss-Newton step, see `apply_identity_increment`.

    model: personal.  eau_sigma: (EAUs,) of the prior.  lips: more rows and residuals over AAUs and
    controls.
    """
    camera, aau, control = fitted.camera, fitted.identity.aau, fitted.control_mm
    shared, per_frame = shared_parameter_count(fitted), 6 + len(EAUS)
    size = shared + per_frame * len(landmarks)
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for number, (state, points_px) in enumerate(zip(fitted.frames, landmarks, strict=True)):
        at = shared + per_frame * number
        own = slice(at, at + per_frame)
        rows, error = _identity_rows(model, camera, state, points_px)
        both, pull = rows @ rows.T, rows @ error
        normal[:shared, :shared] += both[:shared, :shared]
        normal[:shared, own], normal[own, :shared] = both[:shared, shared:], both[shared:, :shared]
        normal[own, own] = both[shared:, shared:]
        gradient[:shared] += pull[:shared]
        gradient[own] = pull[shared:]
        eau = np.arange(at + 6, at + per_frame)
        normal[eau, eau] += 1 / eau_sigma**2
        gradient[eau] -= state.eau / eau_sigma**2
    if lips is not None:
        a, r = lips
        normal[1:shared, 1:shared] += a.T @ a
        gradient[1:shared] += a.T @ r
    deviation = np.log(camera.focal_px / (TYPICAL_FOCAL * max(camera.width, camera.height)))
    sigma = np.r_[RESIDUAL_SIGMA_MM, RESIDUAL_SIGMA_MM, RESIDUAL_DEPTH_SIGMA_MM]
    precision = np.concatenate(
        [
            [1 / LOG_FOCAL_PRIOR_SIGMA**2],
            np.full(len(aau), 1 / AAU_SIGMA**2),
            np.tile(1 / sigma**2, len(control)),
        ]
    )
    values = np.concatenate([[deviation], aau, control.ravel()])
    normal[np.arange(shared), np.arange(shared)] += precision
    gradient[:shared] -= precision * values
    return normal, gradient


def _identity_rows(
    model: LandmarkModel, camera: Camera, state: FaceParameters, points_px: Array
) -> tuple[Array, Array]:
    """(n, 3 m) how one frame's weighted measurements change by log f, AAUs, controls, w, t, EAUs;
    and (3 m,) what they lack.
    """
    target, sigma = observed_points(model, points_px)
    rotation = geometry.matrix_from_quaternion(state.pose.rotation)
    turned, moves = rotated_points(model, rotation, state.eau)
    seen = turned + state.pose.translation_mm
    predicted = geometry.pixel_from_camera(camera, seen)
    bases = rotate_fields(model.aau, rotation)
    controls = model.residual[:, None, None] * rotation.T[..., None]
    # A longer lens at a proportionally larger distance: only perspective changes (see `refocused`).
    away = np.zeros((1, 3, len(seen)))
    away[0, 2] = z = state.pose.translation_mm[2]
    moves = np.concatenate([away, bases, controls.reshape(-1, 3, len(seen)), moves])
    change = projection_jacobian(camera, seen, moves)
    change[0] += (predicted - camera.centre).T
    # The network's z, in pixels, relative to its mean: weak evidence of depth.
    per_mm = camera.focal_px / z
    deeper = (moves[:, 2] - moves[:, 2].mean(1, keepdims=True)) * per_mm
    depth_error = (target[:, 2] - target[:, 2].mean()) - (seen[:, 2] - seen[:, 2].mean()) * per_mm
    w = np.sqrt(model.weight) / sigma
    wz = w * (LANDMARK_SIGMA / DEPTH_SIGMA)
    rows = np.concatenate([(change * w).reshape(len(change), -1), deeper * wz], 1)
    error = (target[:, :2] - predicted).T * w
    return rows, np.append(error, depth_error * wz)
