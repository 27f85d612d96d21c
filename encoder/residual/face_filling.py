"""Continues what is coded around a face smoothly into it, where it is not added: fewest bits."""

import cv2
import numpy as np

from runtime.jit import jit
from shared_model.arrays import Single

# Means are over so many cells across, of which a tile has so many; they count where so much is not
# face.
CELLS_OF_MEAN, CELLS_OF_TILE, MIN_SHARE = 5, 4, 0.05


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
    window = np.s_[top : top + height + 2 * reach, left : left + width + 2 * reach]
    area, inside = face_area[window], result[window]
    sums = np.zeros((-(-len(area) // cell), -(-area.shape[1] // cell), 4), np.float32)
    _sum_up(inside, area, cell, sums)
    means = cv2.blur(sums, (CELLS_OF_MEAN, CELLS_OF_MEAN), borderType=cv2.BORDER_REPLICATE)
    fill = means[..., :3] / np.maximum(means[..., 3:], MIN_SHARE * cell**2)
    size = cell * fill.shape[1], cell * fill.shape[0]
    smooth = cv2.resize(fill, size, interpolation=cv2.INTER_LINEAR)
    _blend(inside, area, np.asarray(smooth, np.float32))
    return result


@jit
def _sum_up(difference: Single, face_area: Single, cell: int, sums: Single) -> None:
    """Add up what is not face, and how much that is, by cells."""
    for i in range(face_area.shape[0]):
        for j in range(face_area.shape[1]):
            weight, own = np.float32(1) - face_area[i, j], sums[i // cell, j // cell]
            for channel in range(3):
                own[channel] += weight * difference[i, j, channel]
            own[3] += weight


@jit
def _blend(difference: Single, face_area: Single, fill: Single) -> None:
    """Mix `fill` into the difference, by the face's area."""
    for i in range(face_area.shape[0]):
        for j in range(face_area.shape[1]):
            share = face_area[i, j]
            if share > 0:
                for channel in range(3):
                    value = difference[i, j, channel]
                    difference[i, j, channel] = value + share * (fill[i, j, channel] - value)
