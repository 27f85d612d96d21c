"""Prediction matrices by numeric differentiation (thesis 2.4.3): additive and project-out."""

from collections.abc import Callable, Sequence

import numpy as np

from aam.model import AppearanceModel, residual, texture_at
from aam.training.faces import TrainingFace
from aam.warps import Warp, pose_displacements
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Single

# Displacements of c (Table 2.4), standard deviations.
C_SIGMAS = (-1.5, -0.5, 0.5, 1.5)
# Added to the balanced normal matrix, of c and of the pose.
RIDGE, POSE_RIDGE = 1e-3, 0.03


def additive_matrix(
    model: AppearanceModel, warp: Warp, faces: Sequence[TrainingFace], truth: Array
) -> Single:
    """(p + M, k) Psi (eq. 2.27): pose and c are displaced one by one as in Table 2.4, the changes
    of the residual smoothed by a Gaussian, averaged over the faces, and inverted for pose and for
    c independently.

    truth: (faces, M) combined parameters.
    """
    poses = len(warp.pose_names)
    steps = pose_displacements(warp)
    for index, sigma in enumerate(model.deviations):
        steps.append((poses + index, [sigmas * float(sigma) for sigmas in C_SIGMAS]))

    def derivatives(number: int) -> Array:
        face, c = faces[number], truth[number]

        def at(step: Array) -> Single:
            pose = warp.displaced(face.pose, step[:poses])
            return residual(model, warp, face.luma, pose, c + step[poses:])

        return _derivatives(at, steps)

    jacobian = _mean(derivatives, len(faces))
    pose, rest = jacobian[:, :poses], jacobian[:, poses:]
    return np.concatenate([_pseudo_inverse(pose, POSE_RIDGE), _pseudo_inverse(rest, RIDGE)])


def project_out_matrix(model: AppearanceModel, warp: Warp, faces: Sequence[TrainingFace]) -> Single:
    """(p + n_s, k): predicts the step of pose and shape coefficients from a texture less the mean.

    What the texture modes explain is projected out of the derivatives (Matthews and Baker 2004);
    these are the mean over the faces of the smallest displacements.
    """
    poses = len(warp.pose_names)
    steps = [(index, _smallest(values)) for index, values in pose_displacements(warp)]
    for index, sigma in enumerate(np.sqrt(model.shape.variances)):
        steps.append((poses + index, [-0.5 * float(sigma), 0.5 * float(sigma)]))

    def derivatives(number: int) -> Array:
        face = faces[number]
        p_s = model.shape.coefficients(face.shape)

        def at(step: Array) -> Single:
            shape = model.shape.values(p_s + step[poses:])
            return texture_at(warp, face.luma, shape, warp.displaced(face.pose, step[:poses]))

        return _derivatives(at, steps)

    jacobian = _mean(derivatives, len(faces))
    modes = model.texture.modes.astype(np.float64)
    # The texture grows with a step away from the truth: the step back is the negative.
    return -_pseudo_inverse(jacobian - modes.T @ (modes @ jacobian), POSE_RIDGE)


def _smallest(values: Sequence[float]) -> list[float]:
    least = min(map(abs, values))
    return [-least, least]


def _derivatives(at: Callable[[Array], Single], steps: list[tuple[int, list[float]]]) -> Array:
    """(k, n) of a function of steps (n,): differences from 0, weighted by a Gaussian as wide as
    the smallest displacement.
    """
    reference = at(np.zeros(len(steps)))
    columns = []
    for index, displacements in steps:
        width = min(map(abs, displacements))
        column, total = np.zeros_like(reference), 0.0
        for value in displacements:
            step = np.zeros(len(steps))
            step[index] = value
            weight = float(np.exp(-0.5 * (value / width) ** 2))
            column += np.float32(weight / value) * (at(step) - reference)
            total += weight
        columns.append(column / np.float32(total))
    return np.stack(columns, 1).astype(np.float64)


def _mean(function: Callable[[int], Array], count: int, chunk: int = 8) -> Array:
    """The mean of function(0), ..., in this order, so that it is the same on every machine."""
    total: Array | float = 0.0
    for start in range(0, count, chunk):
        for each in parallel_map(function, range(start, min(start + chunk, count)), None):
            total = total + each
    return np.asarray(total / count)


def _pseudo_inverse(jacobian: Array, ridge: float) -> Single:
    normal = jacobian.T @ jacobian
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    balanced = normal / np.outer(scale, scale) + ridge * np.eye(len(normal))
    return np.asarray(np.linalg.solve(balanced, (jacobian / scale).T) / scale[:, None], np.float32)
