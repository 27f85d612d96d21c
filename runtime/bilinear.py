"""Bilinear interpolation in images that are stored flat, in compiled loops."""

import numpy as np

from runtime.jit import jit


@jit
def bilinear_weights(
    column: np.float32, row: np.float32, columns: int, rows: int
) -> tuple[int, np.float32, np.float32, np.float32, np.float32]:
    """Where a position lies in an image of `rows` x `columns`; beyond its border: on the border.

    Returns the row-major index of the pixel above and to the left, and the weights of that pixel,
    of those to its right, below, and below right.
    """
    least, one = np.float32(0), np.float32(1)
    u = np.float32(min(max(column, least), np.float32(columns - 1.001)))
    v = np.float32(min(max(row, least), np.float32(rows - 1.001)))
    left, top = int(u), int(v)
    x, y = u - np.float32(left), v - np.float32(top)
    return top * columns + left, (one - x) * (one - y), x * (one - y), (one - x) * y, x * y
