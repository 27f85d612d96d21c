"""Draws a coarse picture from layers, with its derivatives by the layer coefficients, at once.

A coarse picture is small, and drawn several times for each frame that is fitted: what is sampled at
the same place is sampled together, and the rest is one loop.
"""

from typing import NamedTuple

import numpy as np

from encoder.layers.displacement import moved_back, sample
from encoder.layers.scene_motion import scene_origins
from runtime.jit import jit
from shared_model.arrays import Array, Single


class DrawnLayers(NamedTuple):
    """A coarse picture, and how it changes.

    picture: (h, w) luma.  alpha: (h, w) of the person.
    slope: (h, w, 2) grey levels per coarse pixel of the position at which the person is sampled.
    rows: (k + c + s, h, w) grey levels per unit of each coefficient.
    """

    picture: Single
    alpha: Single
    slope: Single
    rows: Single


def draw_layers(
    person: Single,
    opaque: Single,
    scene: Single,
    changes: Single,
    at: Single,
    moves: Single,
    basis: Single,
    coefficients: Array,
) -> DrawnLayers:
    """The picture with these coefficients.

    person: (h, w, 3) luma times alpha, and its derivatives across and down.
    opaque: (h, w, 3) alpha and its derivatives.  scene: (h, w, 3) luma and its derivatives.
    changes: (h, w, c) luma.
    at: (h, w, 2) where the person comes from.  moves: (k, h, w, 2) pixels, of each field there.
    basis: (s, h, w, 2) pixels by which a unit of each coefficient of the scene moves it.
    coefficients: (k + c + s,).
    """
    fields, changed = len(moves), changes.shape[2]
    at = moved_back(at, coefficients[:fields], moves)
    scene_changes = changes
    if len(basis):
        scene_at = scene_origins(basis, coefficients[fields + changed :])
        scene, scene_changes = sample(scene, scene_at), _sample_all(changes, scene_at)
    added = coefficients[fields : fields + changed].astype(np.float32)
    person, opaque, changes = sample(person, at), sample(opaque, at), _sample_all(changes, at)
    drawn = _combine(person, opaque, scene, changes, scene_changes, moves, basis, added)
    picture, slope, rows = drawn
    return DrawnLayers(picture, opaque[..., 0], slope, rows)


def _sample_all(images: Single, at: Single) -> Single:
    """`sample` for any number of channels (h, w, c), none as well."""
    if not images.shape[2]:
        return images
    return sample(images, at).reshape(images.shape)


@jit
def _combine(
    person: Single,
    opaque: Single,
    scene: Single,
    changes: Single,
    scene_changes: Single,
    moves: Single,
    basis: Single,
    added: Single,
) -> tuple[Single, Single, Single]:
    """Picture, slope and rows of `DrawnLayers`, of what was sampled for each pixel."""
    height, width = opaque.shape[:2]
    fields, changed = len(moves), len(added)
    picture = np.empty((height, width), np.float32)
    slope = np.empty((height, width, 2), np.float32)
    rows = np.empty((fields + changed + len(basis), height, width), np.float32)
    one = np.float32(1)
    for row in range(height):
        for column in range(width):
            behind, shown = one - opaque[row, column, 0], scene[row, column, 0]
            picture[row, column] = behind * shown + person[row, column, 0]
            for axis in range(2):
                hidden = shown * opaque[row, column, 1 + axis]
                slope[row, column, axis] = person[row, column, 1 + axis] - hidden
        for field in range(fields):
            for column in range(width):
                across = moves[field, row, column, 0] * slope[row, column, 0]
                down = moves[field, row, column, 1] * slope[row, column, 1]
                rows[field, row, column] = -(across + down)
        for change in range(changed):
            for column in range(width):
                alpha = opaque[row, column, 0]
                own, behind = changes[row, column, change], scene_changes[row, column, change]
                value = (one - alpha) * behind + alpha * own
                rows[fields + change, row, column] = value
                picture[row, column] += added[change] * value
        for number in range(len(basis)):
            for column in range(width):
                across = basis[number, row, column, 0] * scene[row, column, 1]
                down = basis[number, row, column, 1] * scene[row, column, 2]
                behind = one - opaque[row, column, 0]
                rows[fields + changed + number, row, column] = -behind * (across + down)
    return picture, slope, rows
