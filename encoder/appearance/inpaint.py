"""Filling of holes."""

import cv2
import numpy as np
from numpy.typing import NDArray

Texels = NDArray[np.float32]


def fill(image: Texels, known: NDArray[np.bool_]) -> Texels:
    """Smoothly continue an image into where it is unknown: averages from ever coarser scales."""
    weight = known.astype(np.float32)
    if known.all() or min(known.shape) <= 2:
        mean = image[known].mean(0) if known.any() else np.zeros(image.shape[2], np.float32)
        return np.where(known[..., None], image, mean)
    half = (-(-image.shape[1] // 2), -(-image.shape[0] // 2))
    size = (image.shape[1], image.shape[0])
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    total = cv2.resize(image * weight[..., None], half, interpolation=cv2.INTER_AREA)
    # OpenCV drops the axis of a single channel.
    coarse = total.reshape(*share.shape, -1) / np.maximum(share, 1e-6)[..., None]
    filled = fill(coarse.astype(np.float32), share > 1e-6)
    around = cv2.resize(filled, size, interpolation=cv2.INTER_LINEAR).reshape(image.shape)
    return np.where(known[..., None], image, around).astype(np.float32)
