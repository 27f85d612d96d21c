"""Hole filling: unknown parts of an image from their surroundings."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shared_model.appearance import Atlas

Texels = NDArray[np.float32]


def pull_push_fill(image: Texels, known: NDArray[np.bool_]) -> Texels:
    """Fill the unknown pixels of an image (h, w, c) smoothly (pull-push, Gortler et al. 1996).

    Each level of the pyramid is the mean of the known pixels in boxes of the finer one; unknown
    pixels take the interpolated coarser level.  known: (h, w).
    """
    if known.all() or min(known.shape) <= 2:
        mean = image[known].mean(0) if known.any() else np.zeros(image.shape[2], np.float32)
        return np.where(known[..., None], image, mean)
    half = (-(-image.shape[1] // 2), -(-image.shape[0] // 2))
    size = (image.shape[1], image.shape[0])
    weight = known.astype(np.float32)
    coverage = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    total = cv2.resize(image * weight[..., None], half, interpolation=cv2.INTER_AREA)
    # OpenCV drops the axis of a single channel.
    means = total.reshape(*coverage.shape, -1) / np.maximum(coverage, 1e-6)[..., None]
    coarse = pull_push_fill(means.astype(np.float32), coverage > 1e-6)
    smooth = cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR).reshape(image.shape)
    return np.where(known[..., None], image, smooth).astype(np.float32)


def filled_atlas(atlas: Atlas, colours: Texels) -> Texels:
    """The whole atlas (size, size, c) of texel colours (k, c), its unused texels filled."""
    image = np.zeros((atlas.size, atlas.size, colours.shape[1]), np.float32)
    known = np.zeros((atlas.size, atlas.size), bool)
    image[atlas.rows, atlas.columns] = colours
    known[atlas.rows, atlas.columns] = True
    return pull_push_fill(image, known)
