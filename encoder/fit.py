"""Regularised least squares from landmarks: pose, focal length, identity and actuators.

Gauss-Newton on the landmark network's points.  One frame gives a first identity; several frames at
different yaw, solved together, see depth that one frame cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.lips import closing_rows
from shared_model import geometry
from shared_model.animate import Identity, identity_from_controls
from shared_model.anthropometry import residual_basis
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import AAUS, BROW_EAUS, EAUS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]

# Standard deviations of the priors; landmark noise is LANDMARK_SIGMA of the eyes' distance.
LANDMARK_SIGMA = 0.012
DEPTH_SIGMA = 0.08
AAU_SIGMA = 0.5
EAU_SIGMA = 0.4
# The same of actuators that never move, and of brows where an identity is for few actuators: one
# frame's raised brows may as well be high ones.
AT_REST_SIGMA = 1e-3
BROWS_SIGMA = 0.05
RESIDUAL_SIGMA_MM = 2.0
RESIDUAL_DEPTH_SIGMA_MM = 1.2
LOG_FOCAL_SIGMA = 0.15
TYPICAL_FOCAL = 1.3  # of the picture's longer side: a webcam or a portrait lens

# Points of the face's outline.  They slide as the head turns, but where they are not met the
# picture shows background on the face: full weight measured better than less (carphone +0.8 dB).
OUTLINE = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
OUTLINE_WEIGHT = 1.0
EYE_CORNERS = (33, 263)
RIGID = (33, 133, 362, 263, 168, 6, 197, 195, 5, 4, 1, 2, 98, 327, 129, 358, 9, 151, 234, 454, 152)


@dataclass(frozen=True, slots=True)
class LandmarkModel:
    """The head seen through the landmark network: everything at its m points only.

    index: (m,) int, into the network's 468.  neutral: (m, 3) mm.  up, down: (EAUs, m, 3) mm at +-1.
    aau: (11, m, 3) mm.  residual: (k, m) share of each control point.  weight: (m,).
    """

    index: NDArray[np.intp]
    neutral: Array
    up: Array
    down: Array
    aau: Array
    residual: Array
    weight: Array


@dataclass(frozen=True, slots=True)
class Fitted:
    """Who is in the picture and how, in each of the frames fitted together.

    control_mm: (k, 3) displacement of the residual control points.
    """

    camera: Camera
    identity: Identity
    control_mm: Array
    frames: tuple[FaceParameters, ...]


def landmark_model(head: Head) -> LandmarkModel:
    """Gather the head's arrays at the points of the landmark network."""
    index = np.flatnonzero(head.network_triangles >= 0)
    corners = head.triangles[head.network_triangles[index]]
    weights = head.network_weights[index]

    def at(values: Array) -> Array:
        return np.asarray(np.einsum("mc,...mcd->...md", weights, values[..., corners, :]))

    weight = np.ones(len(index))
    weight[np.isin(index, OUTLINE)] = OUTLINE_WEIGHT
    basis = residual_basis(head)
    return LandmarkModel(
        index,
        at(head.vertices),
        at(head.eau_up),
        at(head.eau_down),
        at(head.aau),
        np.einsum("mc,kmc->km", weights, basis[:, corners]),
        weight,
    )


def personalise(model: LandmarkModel, aau: Array, control_mm: Array) -> LandmarkModel:
    """Move the neutral points by AAUs (11,) and residual control displacements (k, 3), mm."""
    moved = model.neutral + np.tensordot(aau, model.aau, 1) + model.residual.T @ control_mm
    return replace(model, neutral=moved)


def fit_frame(
    model: LandmarkModel,
    camera: Camera,
    points_px: Array,
    start: FaceParameters,
    active: Sequence[int] = range(len(EAUS)),
    iterations: int = 4,
) -> FaceParameters:
    """Pose and actuators of one frame; `model` already personal.

    points_px: (468, >= 2) network landmarks, pixels.  start: where the search begins.
    active: the actuators that may move; the others stay where `start` has them.
    """
    target, sigma = _target(model, points_px)
    free = np.r_[0:6, 6 + np.asarray(active, dtype=np.intp)]
    eau_prior = np.full(len(EAUS), 1 / EAU_SIGMA**2)
    current = start
    for _ in range(iterations):
        predicted, jacobian = _observe(model, camera, current)
        scale = np.sqrt(np.repeat(model.weight, 2)) / sigma
        a = jacobian.reshape(-1, jacobian.shape[-1]) * scale[:, None]
        r = (target[:, :2] - predicted).ravel() * scale
        normal = a.T @ a
        normal[6:, 6:] += np.diag(eau_prior)
        gradient = a.T @ r
        gradient[6:] -= eau_prior * current.eau
        step = np.zeros(len(gradient))
        step[free] = np.linalg.solve(normal[np.ix_(free, free)], gradient[free])
        current = _moved(current, step)
    return current


def fit_identity(
    head: Head,
    size: tuple[int, int],
    landmarks: Sequence[Array],
    iterations: int = 12,
    active: Sequence[int] | None = None,
) -> Fitted:
    """Identity and focal length that explain all frames, with pose and actuators of each.

    size: (width, height) of the picture.  landmarks: one (468, 3) array a frame, pixels (z too).
    active: the only actuators that will ever move.  The others then stay at rest, the brows nearly
        so, and the lips meet there, so that these alone can close a mouth that is open in the
        frames.  None: all.
    """
    eau_sigma = _expected_eau(active)
    model = landmark_model(head)
    camera = Camera(*size, TYPICAL_FOCAL * max(size))
    frames = [start_parameters(model, camera, points) for points in landmarks]
    aau, control = np.zeros(len(AAUS)), np.zeros((len(model.residual), 3))
    for _ in range(iterations):
        personal = personalise(model, aau, control)
        lips = None
        if active is not None:
            lips = closing_rows(
                model.index, personal.neutral, model.neutral, model.aau, model.residual
            )
        step = _joint_step(personal, camera, frames, landmarks, aau, control, eau_sigma, lips)
        n = len(AAUS)
        focal = camera.focal_px * float(np.exp(np.clip(step[0], -0.2, 0.2)))
        frames = [_refocus(f, focal / camera.focal_px) for f in frames]
        camera = replace(camera, focal_px=focal)
        aau = np.clip(aau + step[1 : 1 + n], -1.9, 1.9)
        control = control + step[1 + n : 1 + n + control.size].reshape(-1, 3)
        shared = 1 + n + control.size
        per_frame = step[shared:].reshape(len(frames), -1)
        frames = [_moved(f, d) for f, d in zip(frames, per_frame, strict=True)]
    return Fitted(camera, identity_from_controls(head, aau, control), control, tuple(frames))


def _expected_eau(active: Sequence[int] | None) -> Array:
    """(EAUs,) how far actuators are from rest in the frames that show who it is."""
    if active is None:
        return np.full(len(EAUS), EAU_SIGMA)
    sigma = np.full(len(EAUS), AT_REST_SIGMA)
    for index in active:
        sigma[index] = BROWS_SIGMA if EAUS[index].name in BROW_EAUS else EAU_SIGMA
    return sigma


def outline_of(points: Array) -> Array:
    """(n, 2) the face's outline among landmarks (468, >= 2)."""
    return points[list(OUTLINE), :2]


def start_parameters(model: LandmarkModel, camera: Camera, points_px: Array) -> FaceParameters:
    """A first pose, actuators at rest: weak perspective on the rigid points, then Gauss-Newton."""
    position = {int(network): i for i, network in enumerate(model.index)}
    chosen = [position[i] for i in RIGID if i in position]
    points = model.neutral[chosen]
    seen = points_px[model.index[chosen], :3]
    rotation, scale = _weak_perspective(points, seen)
    depth = camera.focal_px / scale
    origin = seen[:, :2].mean(0) - scale * (points.mean(0) @ rotation.T)[:2]
    translation = np.append((origin - camera.centre) * depth / camera.focal_px, depth)
    pose = Pose(geometry.quaternion_from_matrix(rotation), translation)
    return FaceParameters(pose)


def _weak_perspective(points: Array, seen: Array) -> tuple[Array, float]:
    """Rotation and scale (px / mm) that take points (m, 3) to seen (m, 3), Umeyama's solution."""
    a, b = points - points.mean(0), seen - seen.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return u @ sign @ vt, float(np.trace(np.diag(s) @ sign) / (a**2).sum())


def _target(model: LandmarkModel, points_px: Array) -> tuple[Array, float]:
    left, right = points_px[EYE_CORNERS[0], :3], points_px[EYE_CORNERS[1], :3]
    return points_px[model.index], float(LANDMARK_SIGMA * np.linalg.norm(left - right))


def _shape(model: LandmarkModel, eau: Array) -> tuple[Array, Array]:
    """Points (m, 3), head frame, and the field each actuator moves along at its present sign."""
    fields = np.where((eau >= 0)[:, None, None], model.up, -model.down)
    return model.neutral + np.tensordot(eau, fields, 1), fields


def _observe(model: LandmarkModel, camera: Camera, state: FaceParameters) -> tuple[Array, Array]:
    """Projected points (m, 2) and their Jacobian (m, 2, 6 + EAUs): w, t, actuators."""
    points, fields = _shape(model, state.eau)
    rotation = geometry.matrix_from_quaternion(state.pose.rotation)
    turned = points @ rotation.T
    seen = turned + state.pose.translation_mm
    through = projection_jacobian(camera, seen)
    moving = np.concatenate([_cross_columns(turned), np.tile(np.eye(3), (len(points), 1, 1))], 2)
    expressive = np.moveaxis(fields @ rotation.T, 0, 2)
    jacobian = through @ np.concatenate([moving, expressive], 2)
    return geometry.pixel_from_camera(camera, seen), jacobian


def projection_jacobian(camera: Camera, seen: NDArray[Any]) -> Array:
    """d pixel / d point: (m, 2, 3) at camera-frame points (m, 3) (eq. 4.12-4.15)."""
    x, y, z = seen.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [np.stack([one, zero, -x / z], -1), np.stack([zero, one, -y / z], -1)]
    return np.asarray(np.stack(rows, 1) * (camera.focal_px / z)[:, None, None])


def _cross_columns(turned: Array) -> Array:
    """d (w x p) / d w: (m, 3, 3), Table 4.1."""
    x, y, z = turned.T
    zero = np.zeros_like(x)
    rows = [np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)]
    return np.stack(rows, 1)


def _moved(state: FaceParameters, step: Array) -> FaceParameters:
    turn = geometry.quaternion_from_vector(np.clip(step[:3], -0.5, 0.5))
    rotation = geometry.normalise(geometry.multiply(turn, state.pose.rotation))
    pose = Pose(rotation, state.pose.translation_mm + step[3:6])
    return replace(state, pose=pose, eau=clip_eau(state.eau + step[6:]))


def _refocus(state: FaceParameters, ratio: float) -> FaceParameters:
    """Keep the face's size in the picture when the focal length changes by `ratio`."""
    x, y, z = state.pose.translation_mm
    return replace(state, pose=Pose(state.pose.rotation, np.array([x, y, z * ratio])))


def _joint_step(
    model: LandmarkModel,
    camera: Camera,
    frames: Sequence[FaceParameters],
    landmarks: Sequence[Array],
    aau: Array,
    control: Array,
    eau_sigma: Array,
    lips: tuple[Array, Array] | None,
) -> Array:
    """One Gauss-Newton step over log f, AAUs, residual controls, then w, t, EAUs of each frame.

    eau_sigma: (EAUs,) of the prior.  lips: more rows and residuals over AAUs and controls.
    """
    n_aau, n_control = len(aau), control.size
    shared, per_frame = 1 + n_aau + n_control, 6 + len(EAUS)
    size = shared + per_frame * len(frames)
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for number, (state, points_px) in enumerate(zip(frames, landmarks, strict=True)):
        at = shared + per_frame * number
        columns = np.r_[0:shared, at : at + per_frame]
        a, r = _identity_rows(model, camera, state, points_px)
        normal[np.ix_(columns, columns)] += a.T @ a
        gradient[columns] += a.T @ r
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
            [1 / LOG_FOCAL_SIGMA**2],
            np.full(n_aau, 1 / AAU_SIGMA**2),
            np.tile(1 / sigma**2, len(control)),
        ]
    )
    values = np.concatenate([[deviation], aau, control.ravel()])
    normal[np.arange(shared), np.arange(shared)] += precision
    gradient[:shared] -= precision * values
    return np.asarray(np.linalg.solve(normal, gradient), dtype=np.float64)


def _identity_rows(
    model: LandmarkModel, camera: Camera, state: FaceParameters, points_px: Array
) -> tuple[Array, Array]:
    """Weighted rows and residuals of one frame, columns (log f, AAUs, controls, w, t, EAUs)."""
    target, sigma = _target(model, points_px)
    predicted, jacobian = _observe(model, camera, state)
    points, fields = _shape(model, state.eau)
    rotation = geometry.matrix_from_quaternion(state.pose.rotation)
    seen = points @ rotation.T + state.pose.translation_mm
    through = projection_jacobian(camera, seen)
    bases = np.moveaxis(model.aau @ rotation.T, 0, 2)
    controls = np.einsum("km,ij->mikj", model.residual, rotation).reshape(len(points), 3, -1)
    moving = np.concatenate([bases, controls], 2)
    # A longer lens at a proportionally larger distance: only perspective changes (see `_refocus`).
    z = state.pose.translation_mm[2]
    focal = (predicted - camera.centre)[..., None] + through[:, :, 2:3] * z
    rows = np.concatenate([focal, through @ moving, jacobian], 2)
    # The network's z, in pixels, relative to its mean: weak evidence of depth.
    per_mm = camera.focal_px / z
    depth = np.concatenate(
        [
            np.zeros((len(points), 1, 1)),
            moving[:, 2:3],
            _cross_columns(points @ rotation.T)[:, 2:3],
            np.zeros((len(points), 1, 3)),
            np.moveaxis(fields @ rotation.T, 0, 2)[:, 2:3],
        ],
        2,
    )
    depth_rows = (depth[:, 0] - depth[:, 0].mean(0)) * per_mm
    depth_error = (target[:, 2] - target[:, 2].mean()) - (seen[:, 2] - seen[:, 2].mean()) * per_mm
    w = np.sqrt(model.weight) / sigma
    flat = rows.reshape(-1, rows.shape[2]) * np.repeat(w, 2)[:, None]
    r = (target[:, :2] - predicted).ravel() * np.repeat(w, 2)
    wz = w * (LANDMARK_SIGMA / DEPTH_SIGMA)
    return np.concatenate([flat, depth_rows * wz[:, None]]), np.concatenate([r, depth_error * wz])
