"""A cascade of prediction matrices, each trained on what the one before it left over.

One matrix for all displacements (thesis 2.4.3) is a compromise between far and near.  Here the
faces start as a search starts, from the eyes with an error, are moved by the first matrix, and the
second is trained on the errors that are left (Xiong and De la Torre 2013, with the residual of
eq. 2.22 as the feature).  Each half of the people is moved by what the other half taught, so that
the errors are those of people who are not in the training set.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aam.model import AppearanceModel, residual, texture_at
from aam.training.faces import TrainingFace, rescaled, second_half
from aam.training.ridge import fit_ridge
from aam.warps import Warp, pose_from_eyes
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Indices, Single

# Errors of a start: shift in terms of the distance between the eyes (every other start is a far
# one), logarithm of the scale, rotations.
NEAR_SHIFT, FAR_SHIFT, SCALE_SIGMA, TURN_SIGMA_RAD = 0.12, 0.25, 0.06, 0.1
# Bound of combined parameters, standard deviations: in a search; of those that are projected.
LIMIT, PROJECTED_LIMIT = 3.0, 2.0
# Residuals that are computed at once.
_CHUNK = 64


@dataclass(frozen=True, slots=True, eq=False)
class SearchStates:
    """Where searches of the training faces stand; the rows of one face follow each other.

    face: (N,) its index.  pose: (N, p).  c: (N, M).
    """

    face: Indices
    pose: Array
    c: Array


def first_states(
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    repeats: int,
    random: np.random.Generator,
) -> SearchStates:
    """`repeats` starts of each face: the mean shape at the eyes, with an error."""
    mean, count = model.shape_of(np.zeros(len(model.deviations))), len(warp.pose_names)
    poses = []
    for face in faces:
        eyes = warp.landmarks(face.shape, face.pose)[list(warp.eye_corners)]
        middles = eyes.reshape(2, 2, 2).mean(1)
        distance = float(np.linalg.norm(middles[1] - middles[0]))
        for number in range(repeats):
            sigma = FAR_SHIFT if number % 2 else NEAR_SHIFT
            angle = random.uniform(0, 2 * np.pi)
            way = np.array([np.cos(angle), np.sin(angle)])
            step = np.zeros(count)
            step[: count - 3] = random.normal(0, TURN_SIGMA_RAD, count - 3)
            shift_px = random.normal(0, sigma) * distance * way
            step[-1] = random.normal(0, SCALE_SIGMA)
            pose = warp.displaced(pose_from_eyes(warp, mean, middles), step)
            pose[-3:-1] += shift_px
            poses.append(pose)
    index = np.repeat(np.arange(len(faces)), repeats)
    return SearchStates(index, np.array(poses), np.zeros((len(index), len(model.deviations))))


def train_stage(
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    truth: Array,
    states: SearchStates,
) -> tuple[Single, SearchStates]:
    """A prediction matrix (p + M, k), and the states after it.

    truth: (faces, M) combined parameters.
    """
    rows = residuals(model, warp, faces, states)
    pairs = zip(states.face, states.pose, strict=True)
    turns = np.array([warp.step_between(pose, faces[i].pose) for i, pose in pairs])
    targets = np.hstack([turns, truth[states.face] - states.c])
    weights, predicted = fit_ridge(rows, targets, second_half(faces)[states.face])
    count, bound = len(warp.pose_names), LIMIT * model.deviations
    moved = zip(states.pose, predicted[:, :count], strict=True)
    pose = np.array([warp.displaced(pose, step) for pose, step in moved])
    c = np.clip(states.c + predicted[:, count:], -bound, bound)
    return np.ascontiguousarray(weights.T), SearchStates(states.face, pose, c)


def finer_states(
    coarse: AppearanceModel,
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    states: SearchStates,
    ratios: Array,
    repeats: int,
) -> SearchStates:
    """The first `repeats` states of each face at the next level.

    ratios: (faces,) sides of the windows at this level in terms of the coarse one's.
    """
    number = np.arange(len(states.face)) - np.searchsorted(states.face, states.face)
    kept = number < repeats
    face, shapes = states.face[kept], coarse.shape_of(states.c[kept])
    moved = zip(states.pose[kept], ratios[face], strict=True)
    pose = np.array([rescaled(each, ratio) for each, ratio in moved])
    found = zip(face, shapes, pose, strict=True)
    c = [projected(model, warp, faces[i].luma, shape, at) for i, shape, at in found]
    return SearchStates(face, pose, np.array(c))


def projected(model: AppearanceModel, warp: Warp, luma: Single, shape: Array, pose: Array) -> Array:
    """(M,) combined parameters of a shape (n,) and the texture there (eq. 2.20), within bounds."""
    bound = PROJECTED_LIMIT * model.deviations
    c = model.parameters_of(shape, texture_at(warp, luma, shape, pose))
    return np.asarray(np.clip(c, -bound, bound))


def residuals(
    model: AppearanceModel, warp: Warp, faces: Sequence[TrainingFace], states: SearchStates
) -> Single:
    """(N, k) residual of each state."""
    found = np.empty((len(states.face), len(warp.rows)), np.float32)

    def fill(start: int) -> None:
        for row in range(start, min(start + _CHUNK, len(found))):
            luma = faces[states.face[row]].luma
            found[row] = residual(model, warp, luma, states.pose[row], states.c[row])

    parallel_map(fill, range(0, len(found), _CHUNK), None)
    return found
