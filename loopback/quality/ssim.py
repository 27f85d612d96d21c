"""Structural similarity of luma (Wang et al. 2004)."""

import cv2
import numpy as np

from encoder.capture.colour import luma_u8
from shared_model.arrays import Array, Picture

# The Gaussian window, pixels, and the constants (0.01 * 255)^2 and (0.03 * 255)^2.
WINDOW, SIGMA = (11, 11), 1.5
C1, C2 = 6.5025, 58.5225


def ssim_map(original: Picture, copy: Picture) -> Array:
    """(h, w) similarity at each pixel of pictures (h, w, 3) uint8 BGR, 1 where they are equal."""
    a, b = (luma_u8(picture).astype(np.float64) for picture in (original, copy))
    mean_a, mean_b = _blurred(a), _blurred(b)
    variance_a, variance_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
    covariance = _blurred(a * b) - mean_a * mean_b
    likeness = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    return likeness / ((mean_a**2 + mean_b**2 + C1) * (variance_a + variance_b + C2))


def _blurred(values: Array) -> Array:
    return np.asarray(cv2.GaussianBlur(values, WINDOW, SIGMA), np.float64)
