"""Who is in the picture, from landmarks: identity and focal length, by regularised least squares.

One frame gives a first identity; several frames at different yaw, solved together, see depth that
one frame cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.fit import (
    EAU_SIGMA,
    LANDMARK_SIGMA,
    LandmarkModel,
    in_axes,
    landmark_model,
    measured,
    personalise,
    pixel_change,
    start_parameters,
    stepped,
    turned_points,
)
from encoder.lips import closing_rows
from shared_model import geometry
from shared_model.animate import Identity, identity_from_controls
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import AAUS, BROW_EAUS, EAUS, FaceParameters, Pose

Array = NDArray[np.float64]

# Standard deviations of the priors, and of the network's depths in units of the eyes' distance.
DEPTH_SIGMA = 0.08
AAU_SIGMA = 0.5
# Of actuators that never move, and of brows where an identity is for few actuators: one frame's
# raised brows may as well be high ones.
AT_REST_SIGMA = 1e-3
BROWS_SIGMA = 0.05
RESIDUAL_SIGMA_MM = 2.0
RESIDUAL_DEPTH_SIGMA_MM = 1.2
LOG_FOCAL_SIGMA = 0.15
TYPICAL_FOCAL = 1.3  # of the picture's longer side: a webcam or a portrait lens


@dataclass(frozen=True, slots=True)
class Fitted:
    """Who is in the picture and how, in each of the frames fitted together.

    control_mm: (k, 3) displacement of the residual control points.
    """

    camera: Camera
    identity: Identity
    control_mm: Array
    frames: tuple[FaceParameters, ...]


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
        frames = [stepped(f, d) for f, d in zip(frames, per_frame, strict=True)]
    return Fitted(camera, identity_from_controls(head, aau, control), control, tuple(frames))


def _expected_eau(active: Sequence[int] | None) -> Array:
    """(EAUs,) how far actuators are from rest in the frames that show who it is."""
    if active is None:
        return np.full(len(EAUS), EAU_SIGMA)
    sigma = np.full(len(EAUS), AT_REST_SIGMA)
    for index in active:
        sigma[index] = BROWS_SIGMA if EAUS[index].name in BROW_EAUS else EAU_SIGMA
    return sigma


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
    """(n, 3 m) how one frame's weighted measurements change by log f, AAUs, controls, w, t, EAUs;
    and (3 m,) what they lack.
    """
    target, sigma = measured(model, points_px)
    rotation = geometry.matrix_from_quaternion(state.pose.rotation)
    turned, moves = turned_points(model, rotation, state.eau)
    seen = turned + state.pose.translation_mm
    predicted = geometry.pixel_from_camera(camera, seen)
    bases = in_axes(model.aau, rotation)
    controls = model.residual[:, None, None] * rotation.T[..., None]
    # A longer lens at a proportionally larger distance: only perspective changes (see `_refocus`).
    away = np.zeros((1, 3, len(seen)))
    away[0, 2] = z = state.pose.translation_mm[2]
    moves = np.concatenate([away, bases, controls.reshape(-1, 3, len(seen)), moves])
    change = pixel_change(camera, seen, moves)
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
