"""Robust means of pictures over time."""

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]

# Scale of the Cauchy weights, grey levels, and passes.
SCALE_GREY, PASSES = 12.0, 3
# A pixel is known if the frames that show it weigh as much as so many.
MIN_FRAMES = 0.75


def robust_mean(pictures: NDArray[np.generic], weights: Single) -> Single:
    """(h, w, 3) the mean of pictures (n, h, w, 3), outliers of less weight.

    weights: (n, h, w) of the pixels.  Where all are 0 the mean is of no use.
    """
    mean = _weighted_mean(pictures, weights)
    for _ in range(PASSES - 1):
        shares = []
        for picture, weight in zip(pictures, weights, strict=True):
            blue, green, red = np.moveaxis(picture.astype(np.float32) - mean, -1, 0)
            away = (blue + green + red) / 3
            shares.append(weight / (1 + (away / SCALE_GREY) ** 2))
        mean = _weighted_mean(pictures, np.array(shares))
    return mean


def _weighted_mean(pictures: NDArray[np.generic], weights: Single) -> Single:
    total = np.zeros(pictures.shape[1:], np.float32)
    for picture, weight in zip(pictures, weights, strict=True):
        total += picture.astype(np.float32) * weight[..., None]
    return np.asarray(total / np.maximum(weights.sum(0), 1e-6)[..., None])
