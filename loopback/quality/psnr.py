"""Peak signal-to-noise ratio of luma (thesis eq. 6.1)."""

import numpy as np

from encoder.capture.colour import luma_u8
from shared_model.arrays import Array, Picture

# Two pictures without any difference: the error is taken as this, so that a mean stays finite.
LEAST_SQUARED_ERROR = 1e-6


def squared_error(original: Picture, copy: Picture) -> Array:
    """Squared difference of luma, (height, width), of pictures (height, width, 3) uint8 BGR."""
    first, second = (luma_u8(picture).astype(np.float64) for picture in (original, copy))
    return np.asarray((first - second) ** 2)


def psnr_db(error: Array) -> float:
    """Peak signal-to-noise ratio of squared errors, dB (eq. 6.1)."""
    return float(10 * np.log10(255.0**2 / max(float(error.mean()), LEAST_SQUARED_ERROR)))
