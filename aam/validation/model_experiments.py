"""Compactness and specificity (3.1.1, 3.1.3): what the modes span."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aam.model import texture_at
from aam.training.train import combined_model
from aam.validation.contenders import Contender
from aam.validation.planar_warp import PLANAR_LANDMARKS, similarity
from aam.validation.samples import ANATOMICAL, Sample
from shared_model.arrays import Array

# Faces that are drawn at random (3.1.3).
INSTANCES = 210


def mode_counts(contender: Contender, samples: Sequence[Sample]) -> tuple[int, int, int]:
    """Shape, texture and combined modes of the finest level, without mirror images (3.1.1)."""
    level = len(contender.levels) - 1
    options = replace(contender.options, mirror=False)
    model, _ = combined_model(contender.prepared(samples, level), contender.warps[level], options)
    return tuple(len(each.variances) for each in (model.shape, model.texture, model.combined))  # type: ignore[return-value]


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
