"""Continues what is coded around a face smoothly into it, where it is not added: fewest bits."""

import cv2
import numpy as np

from runtime.jit import jit
from shared_model.arrays import Single

# Means are over so many cells across, of which a tile has so many; they count where so much is not
# face.
CELLS_OF_MEAN, CELLS_OF_TILE, MIN_SHARE = 5, 4, 0.05

# Of a picture: top, bottom, left and right, as slices have them.
Window = tuple[int, int, int, int]


def face_filled(difference: Single, face_area: Single, tile: int) -> Single:
    """A difference (h, w, 3) in whose face is what is around.

    face_area: (h, w) 0 to 1, how much each pixel is face.  tile: side of the tiles, pixels.
    """
    result = difference.copy()
    cell = tile // CELLS_OF_TILE
    left, top, width, height = cv2.boundingRect((face_area > 0).view(np.uint8))
    if not width:
        return result
    # Whole cells, and those beside the face that a mean reaches.
    reach = cell * (CELLS_OF_MEAN // 2 + 1)
    top, left = (max(first - reach, 0) // cell * cell for first in (top, left))
    bottom = min(top + height + 2 * reach, len(face_area))
    right = min(left + width + 2 * reach, face_area.shape[1])
    window = top, bottom, left, right
    sums = np.zeros((-(-(bottom - top) // cell), -(-(right - left) // cell), 4), np.float32)
    _sum_up(result, face_area, window, cell, sums)
    means = cv2.blur(sums, (CELLS_OF_MEAN, CELLS_OF_MEAN), borderType=cv2.BORDER_REPLICATE)
    fill = means[..., :3] / np.maximum(means[..., 3:], MIN_SHARE * cell**2)
    size = cell * fill.shape[1], cell * fill.shape[0]
    smooth = np.asarray(cv2.resize(fill, size, interpolation=cv2.INTER_LINEAR), np.float32)
    _blend(result, face_area, window, smooth)
    return result


@jit
def _sum_up(difference: Single, face_area: Single, window: Window, cell: int, sums: Single) -> None:
    """Add up what is not face, and how much that is, by cells of a window."""
    top, bottom, left, right = window
    for i in range(top, bottom):
        for j in range(left, right):
            weight = np.float32(1) - face_area[i, j]
            own = sums[(i - top) // cell, (j - left) // cell]
            for channel in range(3):
                own[channel] += weight * difference[i, j, channel]
            own[3] += weight


@jit
def _blend(difference: Single, face_area: Single, window: Window, fill: Single) -> None:
    """Mix `fill` into a window of the difference, by the face's area."""
    top, bottom, left, right = window
    for i in range(top, bottom):
        for j in range(left, right):
            share = face_area[i, j]
            if share > 0:
                for channel in range(3):
                    value = difference[i, j, channel]
                    change = fill[i - top, j - left, channel] - value
                    difference[i, j, channel] = value + share * change
