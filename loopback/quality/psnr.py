"""Peak signal-to-noise ratio of luma (thesis eq. 6.1)."""

import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_u8

# Two pictures without any difference: the error is taken as this, so that a mean stays finite.
LEAST_SQUARED_ERROR = 1e-6


def squared_error(original: NDArray[np.uint8], copy: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Squared difference of luma, (height, width), of pictures (height, width, 3) uint8 BGR."""
    first, second = (luma_u8(picture).astype(np.float64) for picture in (original, copy))
    return np.asarray((first - second) ** 2)


def psnr_db(error: NDArray[np.float64]) -> float:
    """Peak signal-to-noise ratio of squared errors, dB (eq. 6.1)."""
    return float(10 * np.log10(255.0**2 / max(float(error.mean()), LEAST_SQUARED_ERROR)))
