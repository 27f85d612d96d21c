"""Compactness and specificity (3.1.1, 3.1.3): what the modes span."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from aam.model import texture_at
from aam.training.train import combined_model
from aam.warps import head_warp
from aam.weak_pose import euler_angles_deg
from benchmarks.validate_aam.contenders import Contender
from benchmarks.validate_aam.planar_warp import PLANAR_LANDMARKS, similarity
from benchmarks.validate_aam.samples import ANATOMICAL, Sample
from shared_model.arrays import Array

# Faces that are drawn at random (3.1.3).
INSTANCES = 210
# Turns of the faces in 3.1; landmark error at which modes are counted, and the share of the
# variance of the model whose modes they are.
NEAR_FRONTAL_DEG, EQUAL_ERROR_PX2, DENSE = 15.0, 1.0, 0.98


def mode_counts(contender: Contender, samples: Sequence[Sample]) -> tuple[int, int, int]:
    """Shape, texture and combined modes of the finest level, without mirror images (3.1.1)."""
    level = len(contender.levels) - 1
    options = replace(contender.options, mirror=False)
    model, _ = combined_model(contender.prepared(samples, level), contender.warps[level], options)
    return tuple(len(each.variances) for each in (model.shape, model.texture, model.combined))  # type: ignore[return-value]


def without_forehead(contender: Contender) -> Contender:
    """The AAM of the head on the part of the face that the 2D AAM has."""
    warps = tuple(head_warp(warp.size, "landmarks") for warp in contender.warps)
    return replace(contender, warps=warps)


def is_near_frontal(sample: Sample) -> bool:
    """Whether a head is turned by at most `NEAR_FRONTAL_DEG` about each axis, as in 3.1."""
    return all(abs(angle) <= NEAR_FRONTAL_DEG for angle in euler_angles_deg(sample.face.pose))


def modes_of_equal_error(
    contender: Contender, train: Sequence[Sample], test: Sequence[Sample]
) -> tuple[int, int]:
    """Shape and combined modes that leave `EQUAL_ERROR_PX2` of new faces' landmarks (eq. 3.1).

    The landmarks are those of the contender's own shape, whole, so that what its shapes cannot
    reach anyway does not count.  The modes are those of a model that keeps `DENSE` of the variance;
    if all of them leave more, their number is one less than what is told.
    """
    level, warp = len(contender.levels) - 1, contender.warps[-1]
    options = replace(contender.options, mirror=False, retained=DENSE, shape_retained=None)
    model, _ = combined_model(contender.prepared(train, level), warp, options)
    faces = contender.prepared(test, level)
    shapes = np.array([face.shape for face in faces])
    textures = [texture_at(warp, face.luma, face.shape, face.pose) for face in faces]
    p_s, c = model.shape.coefficients(shapes), model.parameters_of(shapes, np.array(textures))
    chosen = [PLANAR_LANDMARKS.index(index) for index in ANATOMICAL]

    def error(found: Array) -> float:
        squares = []
        for sample, face, shape in zip(test, faces, found, strict=True):
            own, other = (warp.landmarks(each, face.pose) for each in (face.shape, shape))
            left = contender.points(own - other, PLANAR_LANDMARKS)[chosen]
            pixels = sample.eye_distance * len(face.luma) / len(sample.face.window.picture)
            squares.append(((100 * left / pixels) ** 2).sum(1).mean())
        return float(np.mean(squares))

    def fewest(coefficients: Array, shapes_of: Callable[[Array], Array]) -> int:
        total = int(coefficients.shape[1])
        for count in range(1, total + 1):
            kept = np.where(np.arange(total) < count, coefficients, 0.0)
            if error(shapes_of(kept)) <= EQUAL_ERROR_PX2:
                return count
        return total + 1

    return fewest(p_s, model.shape.values), fewest(c, model.shape_of)


def specificity(contender: Contender, samples: Sequence[Sample], seed: int) -> float:
    """S (eq. 3.3): distance of random faces to the nearest of the training set, by eq. 3.1, square
    pixels of a frontal face whose outer corners of the eyes are 100 px apart.

    The combined parameters are drawn from the range that they have in the training set.
    """
    level, random = contender.levels[-1], np.random.default_rng(seed)
    faces = contender.prepared(samples, len(contender.levels) - 1)
    shapes = [face.shape for face in faces]
    textures = [texture_at(contender.warps[-1], face.luma, face.shape, face.pose) for face in faces]
    c = level.parameters_of(np.array(shapes), np.array(textures))
    drawn = random.uniform(c.min(0), c.max(0), (INSTANCES, c.shape[1]))
    known = _frontal(contender, shapes)
    made = _frontal(contender, list(level.shape_of(drawn)))
    distance = ((made[:, None] - known[None]) ** 2).sum(-1).mean(-1)
    return float(distance.min(1).mean())


def _frontal(contender: Contender, shapes: Sequence[Array]) -> Array:
    """(n, 18, 2) anatomical landmarks of shapes, aligned to those of the mean shape."""
    warp, upright = contender.warps[-1], contender.warps[-1].upright(0.0, np.zeros(3))

    def points(shape: Array) -> Array:
        return contender.points(warp.landmarks(shape, upright), PLANAR_LANDMARKS)

    mean = points(contender.levels[-1].shape.mean)
    mean = 100 * mean / np.linalg.norm(mean[45] - mean[36])
    chosen = [PLANAR_LANDMARKS.index(index) for index in ANATOMICAL]
    found = []
    for shape in shapes:
        own = points(shape)
        turn, x, y, size = similarity(own, mean)
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        found.append((np.exp(size) * own @ turned.T + [x, y])[chosen])
    return np.array(found)
