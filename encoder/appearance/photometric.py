"""Photometric normalisation (thesis 2.4.5): retinex, then histogram equalisation.

What is fitted is the luma itself, or what is left of it without the light that falls on the face.
"""

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma

Single = NDArray[np.float32]
Picture = NDArray[np.uint8]
Grey = Callable[[Picture], Single]

# Width of the surround that counts as light, of the picture's longer side.
SURROUND = 0.05
# Keeps the logarithm of the camera's noise in the dark small, grey levels.
DARK_GREY = 8.0
LEVELS = 256


def retinex(picture: Picture) -> Single:
    """(h, w) float32, 0..255: lightness of a face, BGR or luma, apart from its light.

    Retinex with one scale: logarithm of luma over that of its surround, by a Gaussian (Jobson,
    Rahman and Woodell 1997).
    """
    brightness = luma(picture) + np.float32(DARK_GREY)
    sigma = max(SURROUND * max(brightness.shape), 1.0)
    surround = cv2.GaussianBlur(brightness, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    return equalised(np.log(brightness) - np.log(np.asarray(surround, np.float32)))


def equalised(values: Single) -> Single:
    """(h, w) float32: `values` on a scale of 0..255 where every level is as frequent.

    Between the histogram's levels it interpolates: steps would be edges to a gradient.
    """
    low, high = float(values.min()), float(values.max())
    counts, edges = np.histogram(values, LEVELS, (low, max(high, low + 1e-6)))
    share = np.r_[0, np.cumsum(counts)] / values.size
    return np.asarray(255 * np.interp(values, edges, share), np.float32)


NORMALISATIONS: Mapping[str, Grey] = {"none": luma, "retinex": retinex}
