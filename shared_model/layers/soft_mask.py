"""The opacity of the person in a picture of any size: their mask with a soft edge."""

import numpy as np

from shared_model.arrays import Array, Mask

# Standard deviation of the Gaussian kernel that softens the mask, in its cells, and where it ends.
FEATHER_SIGMA, FEATHER_REACH = 1.5, 4
# The range of the softened mask over which opacity rises from 0 to 1: inside the outline, so that
# what stands still beside it is not touched when the person moves.
OPACITY_RANGE = 0.45, 0.9


def opacity(mask: Mask, width: int, height: int) -> Array:
    """(height, width) 0..1: the opacity of the person.  mask: (n, n), true on the person."""
    blur = _blur_matrix(len(mask))
    down, across = (_resampling_matrix(side, len(mask)) @ blur for side in (height, width))
    low, high = OPACITY_RANGE
    return np.clip((down @ mask.astype(np.float64) @ across.T - low) / (high - low), 0, 1)


def _blur_matrix(count: int) -> Array:
    """(count, count) weights of a Gaussian kernel; beyond the ends the last value is repeated."""
    offsets = np.arange(-FEATHER_REACH, FEATHER_REACH + 1)
    kernel = np.exp(-(offsets**2) / (2 * FEATHER_SIGMA**2))
    matrix = np.zeros((count, count))
    for offset, weight in zip(offsets, kernel / kernel.sum(), strict=True):
        np.add.at(matrix, (range(count), np.clip(np.arange(count) + offset, 0, count - 1)), weight)
    return matrix


def _resampling_matrix(count: int, cells: int) -> Array:
    """(count, cells) weights of linear interpolation between the centres of cells."""
    at = np.clip((np.arange(count) + 0.5) * cells / count - 0.5, 0, cells - 1)
    return np.asarray(np.maximum(1 - np.abs(at[:, None] - np.arange(cells)), 0))
