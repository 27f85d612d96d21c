"""How the scene moves as a whole where the camera does: shift, zoom and roll.

A frame shows at x what the picture of the scene has at x - D(x).  D is linear in four coefficients:
shift to the right, shift down, zoom and roll.
"""

import numpy as np

from shared_model.arrays import Array

# The displacement for a coefficient of 1, in the longer side of the picture: of all points when
# the scene shifts, otherwise of those half the longer side off the middle.
UNIT_SHARE = 0.01
# Corners of a picture, texture coordinates.
PICTURE_CORNERS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))


def displacement_basis(width: int, height: int, at_px: Array) -> Array:
    """(4, ..., 2) pixels: D at positions (..., 2) for a coefficient of 1 each.

    width, height: of the picture, pixels.
    """
    longer = max(width, height)
    u, v = np.moveaxis((at_px - (np.array([width, height]) - 1) / 2) / (longer / 2), -1, 0)
    one, zero = np.ones_like(u), np.zeros_like(u)
    fields = [(one, zero), (zero, one), (u, v), (-v, u)]
    return np.array([np.stack(field, -1) for field in fields]) * (UNIT_SHARE * longer)


def moved_corners(width: int, height: int, coefficients: Array) -> Array:
    """(4, 2) where in the picture of the scene the corners of a frame come from.

    Texture coordinates, in the order of `PICTURE_CORNERS`.
    coefficients: (4,); missing ones are 0.
    """
    size = np.array([width, height])
    corners = np.array(PICTURE_CORNERS)
    basis = displacement_basis(width, height, corners * size - 0.5)
    moved = np.tensordot(coefficients, basis[: len(coefficients)], 1)
    return np.asarray(corners - moved / size)
