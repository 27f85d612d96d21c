"""The mean of pictures in which outliers count less, in compiled loops on all cores."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.cauchy_weight import HALF_WEIGHT_GREY
from runtime.jit import jit
from runtime.parallel import available_cores, parallel_map
from shared_model.arrays import Single

# Passes: all but the first by Cauchy weights.
MEAN_PASSES = 3


def robust_mean(
    pictures: NDArray[np.generic], weights: Single, workers: int | None = None
) -> Single:
    """(h, w, 3) the mean of pictures (n, h, w, 3), outliers of less weight.

    weights: (n, h, w) of the pixels.  Where all are 0 the mean is of no use.
    workers: see `parallel_map`.
    """
    # Of one layout, so that there is one compiled loop.
    pictures, weights = np.ascontiguousarray(pictures), np.ascontiguousarray(weights)
    mean = np.empty(pictures.shape[1:], np.float32)
    edges = np.linspace(0, len(mean), (workers or available_cores()) + 1).astype(int).tolist()

    def fill(part: tuple[int, int]) -> None:
        _robust_mean(pictures, weights, mean, *part)

    parallel_map(fill, list(pairwise(edges)), workers)
    return mean


@jit
def _robust_mean(
    pictures: NDArray[np.generic], weights: Single, mean: Single, first: int, end: int
) -> None:
    """Rows `first` to `end` of a mean (h, w, 3), see `robust_mean`."""
    columns = pictures.shape[2]
    one, three, scale = np.float32(1), np.float32(3), np.float32(HALF_WEIGHT_GREY)
    total, trusted = np.empty((columns, 3), np.float32), np.empty(columns, np.float32)
    for row in range(first, end):
        for number in range(MEAN_PASSES):
            total[:], trusted[:] = 0, 0
            for frame in range(len(pictures)):
                for column in range(columns):
                    blue = np.float32(pictures[frame, row, column, 0])
                    green = np.float32(pictures[frame, row, column, 1])
                    red = np.float32(pictures[frame, row, column, 2])
                    weight = weights[frame, row, column]
                    if number > 0:
                        away = blue - mean[row, column, 0]
                        away += green - mean[row, column, 1]
                        away += red - mean[row, column, 2]
                        ratio = away / three / scale
                        weight = weight / (one + ratio * ratio)
                    total[column, 0] += blue * weight
                    total[column, 1] += green * weight
                    total[column, 2] += red * weight
                    trusted[column] += weight
            for column in range(columns):
                weight = max(trusted[column], np.float32(1e-6))
                for channel in range(3):
                    mean[row, column, channel] = total[column, channel] / weight
