"""Pose and actuators of one frame from its landmarks: regularised least squares, Gauss-Newton."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import FACE_OVAL, OUTER_EYE_CORNERS, RIGID_LANDMARKS
from encoder.fitting.increments import apply_clipped_increment
from encoder.runtime.jit import jit
from shared_model import geometry
from shared_model.anthropometry import residual_basis
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import EAUS, FaceParameters, Pose

Array = NDArray[np.float64]

# Standard deviations of landmarks, in units of the eyes' distance, and of actuators about rest: the
# prior of fits that start without an estimate of the expression.
LANDMARK_SIGMA = 0.012
EAU_PRIOR_SIGMA = 0.4
# A step whose linearised decrease of the sum of squares is less than this is the last, in variances
# of one landmark's coordinate.
MIN_DECREASE = 0.5

OUTLINE_WEIGHT = 1.0


@dataclass(frozen=True, slots=True)
class LandmarkModel:
    """The head seen through the landmark network: everything at its m points only.

    index: (m,) int, into the network's 468.  neutral: (m, 3) mm.  up, down: (EAUs, m, 3) mm at +-1.
    aau: (11, m, 3) mm.  residual: (k, m) share of each control point.  weight: (m,).
    """

    index: NDArray[np.intp]
    neutral: Array
    eau_up: Array
    eau_down: Array
    aau: Array
    residual: Array
    weight: Array


def landmark_model(head: Head) -> LandmarkModel:
    """Gather the head's arrays at the points of the landmark network."""
    index = np.flatnonzero(head.network_triangles >= 0)
    corners = head.triangles[head.network_triangles[index]]
    weights = head.network_weights[index]

    def at(values: Array) -> Array:
        gathered = np.einsum("mc,...mcd->...md", weights, values[..., corners, :])
        return np.ascontiguousarray(gathered)

    weight = np.ones(len(index))
    weight[np.isin(index, FACE_OVAL)] = OUTLINE_WEIGHT
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


def fit_landmarks(
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
    iterations: at most; fewer where a step hardly explains more.
    """
    target, sigma = observed_points(model, points_px)
    moving = np.asarray(active, dtype=np.intp)
    free = np.append(np.arange(6), 6 + moving)
    prior = 1 / EAU_PRIOR_SIGMA**2
    scale = np.sqrt(model.weight) / sigma
    current = start
    for _ in range(iterations):
        predicted, change = _observe(model, camera, current)
        rows = (change[free] * scale).reshape(len(free), -1)
        normal = rows @ rows.T
        normal[6:, 6:] += prior * np.eye(len(moving))
        gradient = rows @ ((target[:, :2] - predicted).T * scale).ravel()
        gradient[6:] -= prior * current.eau[moving]
        found = np.linalg.solve(normal, gradient)
        step = np.zeros(len(change))
        step[free] = found
        current = apply_clipped_increment(current, step)
        if found @ gradient < MIN_DECREASE:
            break
    return current


def initial_parameters(model: LandmarkModel, camera: Camera, points_px: Array) -> FaceParameters:
    """A first pose, actuators at rest: weak perspective on the rigid points, then Gauss-Newton."""
    position = {int(network): i for i, network in enumerate(model.index)}
    chosen = [position[i] for i in RIGID_LANDMARKS if i in position]
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


def observed_points(model: LandmarkModel, points_px: Array) -> tuple[Array, float]:
    """The model's points (m, >= 2) among landmarks (468, >= 2), and their uncertainty, pixels."""
    left, right = points_px[OUTER_EYE_CORNERS[0], :3], points_px[OUTER_EYE_CORNERS[1], :3]
    return points_px[model.index], float(LANDMARK_SIGMA * np.linalg.norm(left - right))


def _observe(model: LandmarkModel, camera: Camera, state: FaceParameters) -> tuple[Array, Array]:
    """Projected points (m, 2), and how they change (6 + EAUs, 2, m) by w, t, actuators."""
    rotation = geometry.matrix_from_quaternion(state.pose.rotation)
    turned, moves = rotated_points(model, rotation, state.eau)
    seen = turned + state.pose.translation_mm
    return geometry.pixel_from_camera(camera, seen), projection_jacobian(camera, seen, moves)


def rotated_points(model: LandmarkModel, rotation: Array, eau: Array) -> tuple[Array, Array]:
    """Points (m, 3), camera axes, and how they move (6 + EAUs, 3, m) by w, t, actuators."""
    return _turned(model.neutral, model.eau_up, model.eau_down, rotation, eau)


@jit
def _turned(
    neutral: Array, up: Array, down: Array, rotation: Array, eau: Array
) -> tuple[Array, Array]:
    count = len(neutral)
    points, turned = neutral.copy(), np.empty_like(neutral)
    # By parameter, coordinate, point: what is done to many points runs along memory.
    moves = np.zeros((6 + len(eau), 3, count))
    for number in range(len(eau)):
        for k in range(count):
            if eau[number] >= 0:
                x, y, z = up[number, k]
            else:
                x, y, z = down[number, k]
                x, y, z = -x, -y, -z
            points[k, 0] += eau[number] * x
            points[k, 1] += eau[number] * y
            points[k, 2] += eau[number] * z
            for axis in range(3):
                moves[6 + number, axis, k] = (
                    rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
                )
    for k in range(count):
        x, y, z = points[k]
        for axis in range(3):
            turned[k, axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
            moves[3 + axis, axis, k] = 1
        # d (w x p) / d w, Table 4.1.
        x, y, z = turned[k]
        moves[0, 1, k], moves[0, 2, k] = -z, y
        moves[1, 0, k], moves[1, 2, k] = z, -x
        moves[2, 0, k], moves[2, 1, k] = -y, x
    return turned, moves


def rotate_fields(fields: Array, rotation: Array) -> Array:
    """(..., 3, m) of vectors (..., m, 3): turned into other axes."""
    return (fields.reshape(-1, 3) @ rotation.T).reshape(fields.shape).swapaxes(-1, -2)


def projection_jacobian(camera: Camera, seen: Array, moves: Array) -> Array:
    """(n, 2, m) how pixels change as points (m, 3), camera frame, move (n, 3, m), eq. 4.12-4.15."""
    return _pixel_change(camera.focal_px, seen, moves)


@jit
def _pixel_change(focal_px: float, seen: Array, moves: Array) -> Array:
    x, y, z = seen.T
    per_mm, x, y = focal_px / z, x / z, y / z
    change = np.empty((len(moves), 2, len(seen)))
    for number in range(len(moves)):
        for k in range(len(seen)):
            ahead = moves[number, 2, k]
            change[number, 0, k] = (moves[number, 0, k] - x[k] * ahead) * per_mm[k]
            change[number, 1, k] = (moves[number, 1, k] - y[k] * ahead) * per_mm[k]
    return change
