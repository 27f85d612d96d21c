"""Identity and focal length from landmarks, by regularised least squares.

One frame gives a first identity.  Several frames at different yaw, solved together, determine depth
as well.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from encoder.detection.landmark_indices import INNER_LIP_PAIRS
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.gauss_newton import Damping, Equations, Evaluation, levenberg_marquardt
from encoder.fitting.increments import (
    FACE_PARAMETERS,
    RIGID,
    apply_identity_increment,
    identity_room,
    shared_parameter_count,
)
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
from runtime.parallel import parallel_map
from shared_model import geometry
from shared_model.animate import identity_from_controls
from shared_model.arrays import Array, Indices
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import AAUS, BROW_EAUS, EAUS, FaceParameters
from shared_model.shape_residual import residual_basis

# Standard deviation of the network's depths, in units of the distance between the eyes.
DEPTH_SIGMA = 0.08
# Standard deviations of the priors.
AAU_SIGMA = 0.5
# Of actuators that never move, and of brows where few actuators move: brows that one frame shows
# raised may be part of the shape.
INACTIVE_EAU_SIGMA = 1e-3
BROWS_SIGMA = 0.05
RESIDUAL_SIGMA_MM = 2.0
RESIDUAL_DEPTH_SIGMA_MM = 1.2
# Of the logarithm of the focal length about that of a typical lens.
LOG_FOCAL_PRIOR_SIGMA = 0.15
# Steps are not damped until one has raised the cost: where actuators move the face otherwise up
# than down, full steps go to and fro.
ITERATIONS = 12
DAMPING = Damping(initial=0.0, least_after_increase=0.1, decrease=10.0)
# Focal length of a webcam or a portrait lens, of the picture's longer side.
TYPICAL_FOCAL_RATIO = 1.3
LIP_GAP_SIGMA_MM = 0.3


def fit_identity(
    head: Head,
    size: tuple[int, int],
    landmarks: Sequence[Array],
    active: Sequence[int] | None = None,
    initial: IdentityFit | None = None,
    workers: int | None = 1,
    sigma_ratio: float = 1.0,
) -> IdentityFit:
    """Identity and focal length from all frames, with pose and actuators of each.

    Of one frame the normal matrix at the result is the information.

    size: (width, height) of the picture.  landmarks: one (468, 3) array a frame, pixels (z too).
    active: the actuators that will move later, None: all.  All others are fixed at rest, the brows
        nearly so, and the lips are constrained to meet at rest: the active actuators alone must be
        able to close a mouth that is open in the frames.
    initial: identity from other frames of the same person.
    workers: see `parallel_map`.  sigma_ratio: see `LandmarkSource`.
    """
    eau_sigma = _eau_prior_sigma(active)
    model = landmark_model(head)
    start = initial or generic_identity(head, size)
    personal = personalise(model, start.identity.aau, start.control_mm)
    frames = tuple(initial_parameters(personal, start.camera, points) for points in landmarks)
    fitted = IdentityFit(start.camera, start.identity, start.control_mm, frames)

    def evaluate(fitted: IdentityFit) -> Evaluation:
        personal = personalise(model, fitted.identity.aau, fitted.control_mm)
        lips = None
        if active is not None:
            lips = lip_closure_constraints(
                model.index, personal.neutral, model.neutral, model.aau, model.residual
            )
        problem = personal, fitted, landmarks, eau_sigma, lips
        return Evaluation(
            _cost(*problem, sigma_ratio),
            lambda: _normal_equations(*problem, workers, sigma_ratio),
        )

    fitted, at = levenberg_marquardt(
        evaluate,
        fitted,
        partial(apply_identity_increment, head),
        DAMPING,
        ITERATIONS,
        room=identity_room,
    )
    return replace(fitted, information=at.equations()[0] if len(frames) == 1 else None)


def generic_identity(head: Head, size: tuple[int, int]) -> IdentityFit:
    """The identity of the generic head and a typical focal length, without frames.

    size: (width, height) of the picture.
    """
    control = np.zeros((len(residual_basis(head)), 3))
    identity = identity_from_controls(head, np.zeros(len(AAUS)), control)
    return IdentityFit(Camera(*size, TYPICAL_FOCAL_RATIO * max(size)), identity, control, ())


def _eau_prior_sigma(active: Sequence[int] | None) -> Array:
    """(EAUs,) standard deviations of actuators about rest."""
    if active is None:
        return np.full(len(EAUS), EAU_PRIOR_SIGMA)
    sigma = np.full(len(EAUS), INACTIVE_EAU_SIGMA)
    for index in active:
        sigma[index] = BROWS_SIGMA if EAUS[index].name in BROW_EAUS else EAU_PRIOR_SIGMA
    return sigma


def _normal_equations(
    model: LandmarkModel,
    fitted: IdentityFit,
    landmarks: Sequence[Array],
    eau_sigma: Array,
    lips: tuple[Array, Array] | None,
    workers: int | None,
    sigma_ratio: float,
) -> Equations:
    """Normal matrix and right side of a Gauss-Newton step, see `apply_identity_increment`.

    model: personalised.  eau_sigma: (EAUs,) of the prior.
    lips: rows and residuals of constraints on AAUs and controls.
    workers, sigma_ratio: see `fit_identity`.
    """
    frames = list(zip(fitted.frames, landmarks, strict=True))
    each = parallel_map(
        lambda frame: _frame_equations(model, fitted.camera, *frame, sigma_ratio), frames, workers
    )
    shared = shared_parameter_count(fitted)
    size = shared + FACE_PARAMETERS * len(landmarks)
    normal, right = np.zeros((size, size)), np.zeros(size)
    for number, (face, (block, block_right)) in enumerate(zip(fitted.frames, each, strict=True)):
        offset = shared + FACE_PARAMETERS * number
        own = slice(offset, offset + FACE_PARAMETERS)
        normal[:shared, :shared] += block[:shared, :shared]
        normal[:shared, own] = block[:shared, shared:]
        normal[own, :shared] = block[shared:, :shared]
        normal[own, own] = block[shared:, shared:]
        right[:shared] += block_right[:shared]
        right[own] = block_right[shared:]
        eau = np.arange(offset + RIGID, offset + FACE_PARAMETERS)
        normal[eau, eau] += 1 / eau_sigma**2
        right[eau] -= face.eau / eau_sigma**2
    if lips is not None:
        rows, error = lips
        normal[1:shared, 1:shared] += rows.T @ rows
        right[1:shared] += rows.T @ error
    precision, deviation = _shared_prior(fitted)
    normal[np.arange(shared), np.arange(shared)] += precision
    right[:shared] -= precision * deviation
    return normal, right


def _cost(
    model: LandmarkModel,
    fitted: IdentityFit,
    landmarks: Sequence[Array],
    eau_sigma: Array,
    lips: tuple[Array, Array] | None,
    sigma_ratio: float,
) -> float:
    """Weighted sum of squares, with the priors; see `_normal_equations`."""
    precision, deviation = _shared_prior(fitted)
    cost = precision @ deviation**2
    if lips is not None:
        cost += lips[1] @ lips[1]
    for face, points_px in zip(fitted.frames, landmarks, strict=True):
        rotation = geometry.matrix_from_quaternion(face.pose.rotation)
        points = rotated_points(model, rotation, face.eau)[0] + face.pose.translation_mm
        error = _errors(model, fitted.camera, face, points, points_px, sigma_ratio)
        cost += error @ error + ((face.eau / eau_sigma) ** 2).sum()
    return float(cost)


def _frame_equations(
    model: LandmarkModel,
    camera: Camera,
    face: FaceParameters,
    points_px: Array,
    sigma_ratio: float,
) -> Equations:
    """Of one frame, without priors; see `_identity_jacobian`."""
    rows, error = _identity_jacobian(model, camera, face, points_px, sigma_ratio)
    return rows @ rows.T, rows @ error


def _shared_prior(fitted: IdentityFit) -> tuple[Array, Array]:
    """(n,) precision and deviation from the prior's mean of log f, AAUs, controls."""
    camera, aau, control = fitted.camera, fitted.identity.aau, fitted.control_mm
    log_focal = np.log(camera.focal_px / (TYPICAL_FOCAL_RATIO * max(camera.width, camera.height)))
    sigma_mm = np.r_[RESIDUAL_SIGMA_MM, RESIDUAL_SIGMA_MM, RESIDUAL_DEPTH_SIGMA_MM]
    precision = np.concatenate(
        [
            [1 / LOG_FOCAL_PRIOR_SIGMA**2],
            np.full(len(aau), 1 / AAU_SIGMA**2),
            np.tile(1 / sigma_mm**2, len(control)),
        ]
    )
    return precision, np.concatenate([[log_focal], aau, control.ravel()])


def _identity_jacobian(
    model: LandmarkModel,
    camera: Camera,
    face: FaceParameters,
    points_px: Array,
    sigma_ratio: float,
) -> tuple[Array, Array]:
    """Derivatives (n, 3 m) of one frame's weighted measurements by log f, AAUs, controls, w, t,
    EAUs, and their errors (3 m,).
    """
    rotation = geometry.matrix_from_quaternion(face.pose.rotation)
    rotated, derivatives = rotated_points(model, rotation, face.eau)
    points = rotated + face.pose.translation_mm
    predicted = geometry.pixel_from_camera(camera, points)
    aau = rotate_fields(model.aau, rotation)
    controls = model.residual[:, None, None] * rotation.T[..., None]
    # Depth changes in proportion to the focal length, see `with_focal_change`.
    recession = np.zeros((1, 3, len(points)))
    recession[0, 2] = depth_mm = face.pose.translation_mm[2]
    derivatives = np.concatenate(
        [recession, aau, controls.reshape(-1, 3, len(points)), derivatives]
    )
    jacobian = projection_jacobian(camera, points, derivatives)
    jacobian[0] += (predicted - camera.centre).T
    # The network's z, in pixels, relative to its mean, is weak evidence of depth.
    px_per_mm = camera.focal_px / depth_mm
    z_rows = (derivatives[:, 2] - derivatives[:, 2].mean(1, keepdims=True)) * px_per_mm
    weight, z_weight = _weights(observed_points(model, points_px)[1], sigma_ratio)
    rows = np.concatenate([(jacobian * weight).reshape(len(jacobian), -1), z_rows * z_weight], 1)
    return rows, _errors(model, camera, face, points, points_px, sigma_ratio)


def _errors(
    model: LandmarkModel,
    camera: Camera,
    face: FaceParameters,
    points: Array,
    points_px: Array,
    sigma_ratio: float,
) -> Array:
    """(3 m,) weighted errors of a face's points (m, 3), camera frame; see `_identity_jacobian`."""
    target, sigma_px = observed_points(model, points_px)
    weight, z_weight = _weights(sigma_px, sigma_ratio)
    error = (target[:, :2] - geometry.pixel_from_camera(camera, points)).T * weight
    z_px = (points[:, 2] - points[:, 2].mean()) * (camera.focal_px / face.pose.translation_mm[2])
    z_error = (target[:, 2] - target[:, 2].mean()) - z_px
    return np.append(error, z_error * z_weight)


def _weights(sigma_px: float, sigma_ratio: float) -> tuple[float, float]:
    """Of the errors of pixels, and of depths in pixels.  sigma_px: of a landmark."""
    weight = 1 / (sigma_ratio * sigma_px)
    return weight, weight * (LANDMARK_SIGMA / DEPTH_SIGMA)


def lip_closure_constraints(
    index: Indices, neutral: Array, generic: Array, aau: Array, residual: Array
) -> tuple[Array, Array]:
    """Rows (15, 11 + 3 k) and residuals (15,), in sigmas: the lips' gap at rest equals `generic`'s.

    index: (m,) ascending, indices of the points in the network.  neutral, generic: (m, 3) mm, of
    the person and of the generic head.  aau: (11, m, 3) mm.  residual: (k, m) weight of each
    control point.  Columns: AAUs, then x, y, z of each control point.
    """
    upper, lower = (np.searchsorted(index, points) for points in INNER_LIP_PAIRS)
    aau_columns = np.moveaxis(aau[:, upper] - aau[:, lower], 0, 2)
    weight = residual[:, upper] - residual[:, lower]
    controls = np.einsum("km,ij->mikj", weight, np.eye(3)).reshape(len(upper), 3, -1)
    rows = np.concatenate([aau_columns, controls], 2)
    displacement = neutral - generic
    gap = (displacement[lower] - displacement[upper]).ravel()
    return rows.reshape(-1, rows.shape[2]) / LIP_GAP_SIGMA_MM, gap / LIP_GAP_SIGMA_MM
