"""The 3D model fitted to the landmarks of one still picture (thesis 2.4.1).

Gauss-Newton over AAUs, EAUs and pose, under weak perspective (eq. 2.16) or full perspective with a
typical lens (eq. 2.15).  One still tells nothing of the lens, so that its focal length is fixed.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from aam.annotation.held_values import HeldValues
from aam.annotation.landmark_schemes import FaceLandmarks
from aam.shape_space import FITTED_EAUS, shape_vector
from aam.weak_pose import POSE_COUNT, perspective_pose, pose_vector, telephoto
from encoder.detection.landmark_indices import EYELID_MARGINS, OUTER_EYE_CORNERS
from encoder.fitting.eyelids import with_measured_eyelids
from encoder.fitting.gauss_newton import Equations, Room, gauss_newton
from encoder.fitting.identity import (
    AAU_SIGMA,
    DEPTH_SIGMA,
    RESIDUAL_DEPTH_SIGMA_MM,
    RESIDUAL_SIGMA_MM,
    TYPICAL_FOCAL_RATIO,
)
from encoder.fitting.increments import AAU_LIMIT, eau_room
from encoder.fitting.landmark_fit import (
    EAU_PRIOR_SIGMA,
    LANDMARK_SIGMA,
    LandmarkModel,
    landmark_model,
    personalise,
    projection_jacobian,
    rotate_fields,
    rotated_points,
)
from shared_model import geometry
from shared_model.arrays import Array
from shared_model.geometry import FRONTAL, Camera
from shared_model.mesh import Head, generic_head
from shared_model.parameters import AAUS, FaceParameters, clip_eau
from shared_model.shape_residual import residual_basis

PROJECTIONS = ("weak", "perspective")
ITERATIONS = 15
# The largest step of a rotation, radians, and of AAUs and EAUs.
MAX_TURN_RAD, MAX_ACTUATOR = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class StillFit:
    """The model in one picture.

    projection: one of `PROJECTIONS`.  camera: of the picture; weak perspective: a very long lens.
    face: pose and EAUs.  aau: (11,).  control_mm: (k, 3) residual shape, zero unless it was fitted.
    error: root mean square distance of model and landmarks, of the distance between the outer
        corners of the eyes.
    """

    projection: str
    camera: Camera
    face: FaceParameters
    aau: Array
    control_mm: Array
    error: float

    @property
    def pose(self) -> Array:
        """(6,) of weak perspective, see `aam.weak_pose`."""
        return pose_vector(self.face.pose, self.camera)

    @property
    def shape(self) -> Array:
        """(25,) AE shape vector."""
        return shape_vector(self.aau, self.face.eau)


@cache
def _generic_landmark_model() -> LandmarkModel:
    return landmark_model(generic_head())


def fit_still(
    head: Head,
    size: tuple[int, int],
    landmarks: FaceLandmarks,
    projection: str = "weak",
    residual: bool = False,
    held: HeldValues | None = None,
) -> StillFit:
    """Pose, AAUs and EAUs that explain the landmarks of one picture.

    size: (width, height) of the picture.  residual: fit the residual shape as well.
    held: what stays as it is told; None: nothing.
    Raises `ValueError` if the outer corners of the eyes or too many landmarks are unknown.
    """
    if projection not in PROJECTIONS:
        raise ValueError(f"projection is {projection!r}, expected one of {PROJECTIONS}")
    full = _generic_landmark_model() if head is generic_head() else landmark_model(head)
    model, target, sigma_px = _observed(full, landmarks)
    is_weak = projection == "weak"
    held = held or HeldValues.none()
    pose = _first_pose(model, target) if held.pose is None else held.pose
    aau, eau = held.start()
    start = _State(pose, aau, np.zeros((len(residual_basis(head)), 3)), eau)
    camera = Camera(*size, TYPICAL_FOCAL_RATIO * max(size))
    lens, controls = None if is_weak else camera, start.control_mm.size if residual else 0
    state = gauss_newton(
        lambda at: _equations(model, at, target, sigma_px, lens, controls),
        start,
        lambda at, step: _moved(at, step, controls),
        ITERATIONS,
        room=lambda at: _room(at, controls),
        free=held.free(controls),
    )
    if is_weak:
        camera, at = telephoto(state.pose, size)
    else:
        at = perspective_pose(state.pose, camera)
    face = FaceParameters(at, state.eau)
    personal = personalise(full, state.aau, state.control_mm)
    if np.isfinite(landmarks.points[list(sum(EYELID_MARGINS, ())), 0]).all():
        face = with_measured_eyelids(personal, camera, landmarks.points, face)
        face = replace(face, eau=held.applied(face.eau))
    fitted = StillFit(projection, camera, face, state.aau, state.control_mm, 0.0)
    return replace(fitted, error=_error(model, fitted, target))


@dataclass(frozen=True, slots=True)
class _State:
    """pose: (6,) weak-perspective vector, the parameters of both projections."""

    pose: Array
    aau: Array
    control_mm: Array
    eau: Array


def _observed(model: LandmarkModel, landmarks: FaceLandmarks) -> tuple[LandmarkModel, Array, Array]:
    """The model at the known landmarks, these (m, 3), and their standard deviations (m,), px."""
    known = np.isfinite(landmarks.points[model.index, 0])
    if known.sum() < 20 or not np.isfinite(landmarks.points[list(OUTER_EYE_CORNERS), 0]).all():
        raise ValueError(
            f"{int(known.sum())} landmarks are known, expected 20 and the eyes' outer corners"
        )
    chosen = LandmarkModel(
        model.index[known],
        model.neutral[known],
        np.ascontiguousarray(model.eau_up[:, known]),
        np.ascontiguousarray(model.eau_down[:, known]),
        np.ascontiguousarray(model.aau[:, known]),
        model.residual[:, known],
    )
    points = landmarks.points[chosen.index]
    right, left = (landmarks.points[i, :2] for i in OUTER_EYE_CORNERS)
    # Few landmarks say less than many: their deviations do not shrink with their number.
    spread = np.sqrt(len(model.index) / len(points)) ** 0.5
    sigma = LANDMARK_SIGMA * float(np.linalg.norm(left - right)) / spread
    return chosen, points, sigma * landmarks.sigma[chosen.index]


def _first_pose(model: LandmarkModel, target: Array) -> Array:
    """(6,) upright in the plane of the picture, from the outer corners of the eyes and the rest."""
    points = model.neutral[:, :2] * [1, -1]
    a, b = points - points.mean(0), target[:, :2] - target[:, :2].mean(0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    scale = float((a @ rotation.T * b).sum() / (a**2).sum())
    origin = target[:, :2].mean(0) - scale * points.mean(0) @ rotation.T
    # A clockwise turn in the picture is one about the head's -z.
    return np.array([0.0, 0.0, -turn, *origin, np.log(scale)])


def _project(
    pose: Array, rotated: Array, derivatives: Array, camera: Camera | None
) -> tuple[Array, Array]:
    """Pixels (m, 2) of rotated points (m, 3), mm, and the Jacobian (n + 3, 2, m): of the
    derivatives (n, 3, m) of the points, then of x, y, log scale.  camera: None: weak perspective.
    """
    scale = np.exp(pose[5])
    if camera is None:
        pixels = scale * rotated[:, :2] + pose[3:5]
        jacobian = scale * derivatives[:, :2]
        rows = np.zeros((3, 2, len(rotated)))
        rows[0, 0] = rows[1, 1] = 1
        rows[2] = scale * rotated[:, :2].T
        return pixels, np.concatenate([jacobian, rows])
    translation = perspective_pose(pose, camera).translation_mm
    points = rotated + translation
    moves = np.zeros((3, 3, len(rotated)))
    moves[0, 0] = moves[1, 1] = 1 / scale
    moves[2] = -translation[:, None]
    every = np.concatenate([derivatives, moves])
    return geometry.pixel_from_camera(camera, points), projection_jacobian(camera, points, every)


def _equations(
    model: LandmarkModel,
    state: _State,
    target: Array,
    sigma_px: Array,
    camera: Camera | None,
    controls: int,
) -> Equations:
    """Normal equations of a step over AAUs, controls, EAUs, rotation, x, y, log scale.

    controls: number of values of the residual shape that are fitted.
    """
    personal = personalise(model, state.aau, state.control_mm)
    turn = geometry.quaternion_from_vector(state.pose[:3])
    orientation = geometry.normalise(geometry.multiply(np.array(FRONTAL), turn))
    rotation = geometry.matrix_from_quaternion(orientation)
    rotated, moved = rotated_points(personal, rotation, state.eau)
    shape = (model.residual[:, None, None] * rotation.T[..., None]).reshape(-1, 3, len(rotated))
    fitted = np.array(FITTED_EAUS)
    fields = np.concatenate(
        [rotate_fields(model.aau, rotation), shape[:controls], moved[6 + fitted], moved[:3]]
    )
    pixels, jacobian = _project(state.pose, rotated, fields, camera)
    rows = (jacobian / sigma_px).reshape(len(jacobian), -1)
    error = ((target[:, :2] - pixels).T / sigma_px).ravel()
    depth_rows, depth_error = _depth_evidence(state, rotated, fields, target, sigma_px)
    rows, error = np.hstack([rows, depth_rows]), np.append(error, depth_error)
    sigma = _prior_sigma(controls, len(fitted))
    values = np.zeros(len(rows))
    values[: len(sigma)] = np.concatenate(
        [state.aau, state.control_mm.ravel()[:controls], state.eau[fitted]]
    )
    precision = np.zeros(len(rows))
    precision[: len(sigma)] = 1 / sigma**2
    return rows @ rows.T + np.diag(precision + 1e-9), rows @ error - precision * values


def _room(state: _State, controls: int) -> Room:
    """How far each value of a step may go down and up, in the order of `_equations`."""
    others = np.full(controls, np.inf)
    low, high = eau_room(state.eau, np.array(FITTED_EAUS))
    pose = np.full(POSE_COUNT, np.inf)
    return (
        np.concatenate([-AAU_LIMIT - state.aau, -others, low, -pose]),
        np.concatenate([AAU_LIMIT - state.aau, others, high, pose]),
    )


def _depth_evidence(
    state: _State, rotated: Array, fields: Array, target: Array, sigma_px: Array
) -> tuple[Array, Array]:
    """Rows (n + 3, m) and errors (m,) of the network's depth about its mean; none if unknown."""
    if not np.isfinite(target[:, 2]).all():
        return np.zeros((len(fields) + 3, 0)), np.zeros(0)
    scale, weight = np.exp(state.pose[5]), LANDMARK_SIGMA / DEPTH_SIGMA / sigma_px
    depth = scale * (rotated[:, 2] - rotated[:, 2].mean())
    rows = scale * (fields[:, 2] - fields[:, 2].mean(1, keepdims=True))
    error = target[:, 2] - target[:, 2].mean() - depth
    return np.concatenate([rows, np.zeros((3, len(depth)))]) * weight, error * weight


def _prior_sigma(controls: int, eaus: int) -> Array:
    sigma_mm = np.array([RESIDUAL_SIGMA_MM, RESIDUAL_SIGMA_MM, RESIDUAL_DEPTH_SIGMA_MM])
    return np.concatenate(
        [
            np.full(len(AAUS), AAU_SIGMA),
            np.tile(sigma_mm, controls // 3),
            np.full(eaus, EAU_PRIOR_SIGMA),
        ]
    )


def _moved(state: _State, step: Array, controls: int) -> _State:
    """The state after a step in the order of `_equations`; the rotation is in camera axes."""
    n, fitted = len(AAUS), np.array(FITTED_EAUS)
    end = n + controls + len(fitted)
    aau = np.clip(state.aau + step[:n], -AAU_LIMIT, AAU_LIMIT)
    control = state.control_mm
    if controls:
        control = control + step[n : n + controls].reshape(-1, 3)
    eau = state.eau.copy()
    eau[fitted] += np.clip(step[n + controls : end], -MAX_ACTUATOR, MAX_ACTUATOR)
    turn = np.clip(step[end : end + 3], -MAX_TURN_RAD, MAX_TURN_RAD)
    # A turn about camera axes is one about head axes with y and z reversed, before `FRONTAL`.
    before = geometry.quaternion_from_vector(turn * [1, -1, -1])
    rotation = geometry.multiply(before, geometry.quaternion_from_vector(state.pose[:3]))
    pose = np.concatenate(
        [geometry.vector_from_quaternion(rotation), state.pose[3:] + step[end + 3 :]]
    )
    assert len(pose) == POSE_COUNT
    return _State(pose, aau, control, clip_eau(eau))


def _error(model: LandmarkModel, fitted: StillFit, target: Array) -> float:
    """See `StillFit.error`."""
    personal = personalise(model, fitted.aau, fitted.control_mm)
    rotation = geometry.matrix_from_quaternion(fitted.face.pose.rotation)
    rotated, _ = rotated_points(personal, rotation, fitted.face.eau)
    points = rotated + fitted.face.pose.translation_mm
    pixels = geometry.pixel_from_camera(fitted.camera, points)
    at = [int(np.flatnonzero(model.index == corner)[0]) for corner in OUTER_EYE_CORNERS]
    eyes = float(np.linalg.norm(target[at[0], :2] - target[at[1], :2]))
    return float(np.sqrt(((pixels - target[:, :2]) ** 2).sum(1).mean()) / eyes)
