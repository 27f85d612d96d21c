"""Pose and actuators of one frame from its landmarks, by regularised least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from encoder.detection.landmark_indices import OUTER_EYE_CORNERS, RIGID_LANDMARKS
from encoder.fitting.gauss_newton import Equations, gauss_newton
from encoder.fitting.increments import RIGID, actuator_room, apply_clipped_increment
from runtime.jit import jit
from shared_model import geometry
from shared_model.arrays import Array, Indices
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import EAUS, FaceParameters, Pose
from shared_model.shape_residual import residual_basis

# Standard deviation of landmarks, in units of the distance between the eyes.
LANDMARK_SIGMA = 0.012
# Standard deviation of actuators about rest: the prior of fits that have no estimate of the
# expression.
EAU_PRIOR_SIGMA = 0.4
# Iterations end when a step's linearised decrease of the sum of squares is less than this, in
# variances of one coordinate of a landmark.
MIN_DECREASE = 0.5


@dataclass(frozen=True, slots=True)
class LandmarkModel:
    """The head model, restricted to the m points that the landmark network finds.

    index: (m,) int, ascending, into the network's 468 landmarks.  neutral: (m, 3) mm.
    eau_up, eau_down: (EAUs, m, 3) mm, displacement by each actuator at 1 and at -1.
    aau: (11, m, 3) mm.  residual: (k, m) weight of each control point of the shape residual.
    """

    index: Indices
    neutral: Array
    eau_up: Array
    eau_down: Array
    aau: Array
    residual: Array


def landmark_model(head: Head) -> LandmarkModel:
    """Interpolate the head's arrays at the points of the landmark network."""
    index = np.flatnonzero(head.network_triangles >= 0)
    corners = head.triangles[head.network_triangles[index]]
    weights = head.network_weights[index]

    def at_points(values: Array) -> Array:
        gathered = np.einsum("mc,...mcd->...md", weights, values[..., corners, :])
        return np.ascontiguousarray(gathered)

    basis = residual_basis(head)
    return LandmarkModel(
        index,
        at_points(head.vertices),
        at_points(head.eau_up),
        at_points(head.eau_down),
        at_points(head.aau),
        np.einsum("mc,kmc->km", weights, basis[:, corners]),
    )


def personalise(model: LandmarkModel, aau: Array, control_mm: Array) -> LandmarkModel:
    """Displace the neutral points by AAUs (11,) and residual control points (k, 3), mm."""
    neutral = model.neutral + np.tensordot(aau, model.aau, 1) + model.residual.T @ control_mm
    return replace(model, neutral=neutral)


def fit_landmarks(
    model: LandmarkModel,
    camera: Camera,
    points_px: Array,
    start: FaceParameters,
    active: Sequence[int] = range(len(EAUS)),
    iterations: int = 4,
) -> FaceParameters:
    """Pose and actuators of one frame, by plain Gauss-Newton steps from `start`.

    model: personalised.  points_px: (468, >= 2) network landmarks, pixels.
    active: actuators that are fitted; the others keep the values of `start`.
    iterations: at most; see `MIN_DECREASE`.
    """
    target, sigma_px = observed_points(model, points_px)
    fitted = np.asarray(active, dtype=np.intp)
    free = np.append(np.arange(RIGID), RIGID + fitted)
    prior, scale = 1 / EAU_PRIOR_SIGMA**2, 1 / sigma_px

    def equations(face: FaceParameters) -> Equations:
        predicted, jacobian = _project_with_jacobian(model, camera, face)
        rows = (jacobian[free] * scale).reshape(len(free), -1)
        normal = rows @ rows.T
        normal[RIGID:, RIGID:] += prior * np.eye(len(fitted))
        right = rows @ ((target[:, :2] - predicted).T * scale).ravel()
        right[RIGID:] -= prior * face.eau[fitted]
        return normal, right

    def moved(face: FaceParameters, solution: Array) -> FaceParameters:
        step = np.zeros(RIGID + len(EAUS))
        step[free] = solution
        return apply_clipped_increment(face, step)

    room = partial(actuator_room, active=fitted)
    return gauss_newton(equations, start, moved, iterations, MIN_DECREASE, room)


def initial_parameters(model: LandmarkModel, camera: Camera, points_px: Array) -> FaceParameters:
    """The weak-perspective pose of the rigid landmarks, actuators at rest.

    points_px: (468, 3) network landmarks, pixels.
    """
    position = {int(landmark): i for i, landmark in enumerate(model.index)}
    chosen = [position[i] for i in RIGID_LANDMARKS if i in position]
    points = model.neutral[chosen]
    target = points_px[model.index[chosen], :3]
    rotation, scale = _similarity(points, target)
    depth = camera.focal_px / scale
    origin = target[:, :2].mean(0) - scale * (points.mean(0) @ rotation.T)[:2]
    translation = np.append((origin - camera.centre) * depth / camera.focal_px, depth)
    return FaceParameters(Pose(geometry.quaternion_from_matrix(rotation), translation))


def _similarity(points: Array, target: Array) -> tuple[Array, float]:
    """Rotation and scale (px / mm) from points (m, 3) to target (m, 3) (Umeyama 1991)."""
    a, b = points - points.mean(0), target - target.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return u @ sign @ vt, float(np.trace(np.diag(s) @ sign) / (a**2).sum())


def observed_points(model: LandmarkModel, points_px: Array) -> tuple[Array, float]:
    """The model's points (m, >= 2) among landmarks (468, >= 2), and their deviation, pixels."""
    left, right = points_px[OUTER_EYE_CORNERS[0], :3], points_px[OUTER_EYE_CORNERS[1], :3]
    return points_px[model.index], float(LANDMARK_SIGMA * np.linalg.norm(left - right))


def _project_with_jacobian(
    model: LandmarkModel, camera: Camera, face: FaceParameters
) -> tuple[Array, Array]:
    """Projected points (m, 2), and their derivatives (6 + EAUs, 2, m) by w, t, actuators."""
    rotation = geometry.matrix_from_quaternion(face.pose.rotation)
    rotated, derivatives = rotated_points(model, rotation, face.eau)
    points = rotated + face.pose.translation_mm
    pixels = geometry.pixel_from_camera(camera, points)
    return pixels, projection_jacobian(camera, points, derivatives)


def rotated_points(model: LandmarkModel, rotation: Array, eau: Array) -> tuple[Array, Array]:
    """Points (m, 3), camera axes, and their derivatives (6 + EAUs, 3, m) by w, t, actuators."""
    return _rotated_points(model.neutral, model.eau_up, model.eau_down, rotation, eau)


@jit
def _rotated_points(
    neutral: Array, eau_up: Array, eau_down: Array, rotation: Array, eau: Array
) -> tuple[Array, Array]:
    count = len(neutral)
    points, rotated = neutral.copy(), np.empty_like(neutral)
    # Parameters first, points last: loops over points then run along memory.
    derivatives = np.zeros((6 + len(eau), 3, count))
    for number in range(len(eau)):
        for k in range(count):
            if eau[number] >= 0:
                x, y, z = eau_up[number, k]
            else:
                x, y, z = eau_down[number, k]
                x, y, z = -x, -y, -z
            points[k, 0] += eau[number] * x
            points[k, 1] += eau[number] * y
            points[k, 2] += eau[number] * z
            for axis in range(3):
                derivatives[6 + number, axis, k] = (
                    rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
                )
    for k in range(count):
        x, y, z = points[k]
        for axis in range(3):
            rotated[k, axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
            derivatives[3 + axis, axis, k] = 1
        # d (w x p) / d w, Table 4.1.
        x, y, z = rotated[k]
        derivatives[0, 1, k], derivatives[0, 2, k] = -z, y
        derivatives[1, 0, k], derivatives[1, 2, k] = z, -x
        derivatives[2, 0, k], derivatives[2, 1, k] = -y, x
    return rotated, derivatives


def rotate_fields(fields: Array, rotation: Array) -> Array:
    """Vectors (..., m, 3) in rotated axes: (..., 3, m)."""
    return (fields.reshape(-1, 3) @ rotation.T).reshape(fields.shape).swapaxes(-1, -2)


def projection_jacobian(camera: Camera, points: Array, derivatives: Array) -> Array:
    """(n, 2, m) derivatives of pixels of points (m, 3), camera frame (eq. 4.12-4.15).

    derivatives: (n, 3, m) of the points by n parameters.
    """
    return _projection_jacobian(camera.focal_px, points, derivatives)


@jit
def _projection_jacobian(focal_px: float, points: Array, derivatives: Array) -> Array:
    x, y, z = points.T
    px_per_mm, x, y = focal_px / z, x / z, y / z
    jacobian = np.empty((len(derivatives), 2, len(points)))
    for number in range(len(derivatives)):
        for k in range(len(points)):
            dz = derivatives[number, 2, k]
            jacobian[number, 0, k] = (derivatives[number, 0, k] - x[k] * dz) * px_per_mm[k]
            jacobian[number, 1, k] = (derivatives[number, 1, k] - y[k] * dz) * px_per_mm[k]
    return jacobian
