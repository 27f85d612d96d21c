"""Photometric normalisation (thesis 2.4.5): what a fit compares instead of the luma itself.

Retinex and histogram equalisation remove most of the illumination of the face.
"""

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from encoder.capture.colour import luma_f32
from shared_model.arrays import Picture, Single

# Maps a picture, (h, w, 3) uint8 BGR or (h, w) uint8 luma, to grey levels (h, w) float32.
Normalisation = Callable[[Picture], Single]

# Standard deviation of the surround, in terms of the picture's longer side.
SURROUND_SIGMA = 0.05
# Is added to the luma, grey levels: keeps the logarithm of the camera's noise in the dark small.
DARK_OFFSET_GREY = 8.0
HISTOGRAM_BINS = 256


def retinex(picture: Picture) -> Single:
    """(h, w) float32, 0..255: single-scale retinex (Jobson, Rahman and Woodell 1997), equalised.

    picture: (h, w, 3) uint8 BGR or (h, w) uint8 luma.
    """
    brightness = luma_f32(picture) + np.float32(DARK_OFFSET_GREY)
    sigma = max(SURROUND_SIGMA * max(brightness.shape), 1.0)
    surround = cv2.GaussianBlur(brightness, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    return equalise_histogram(np.log(brightness) - np.log(np.asarray(surround, np.float32)))


def equalise_histogram(values: Single) -> Single:
    """(h, w) float32: `values` mapped to 0..255 so that all levels are equally frequent.

    The map interpolates between bins, since steps would be edges to a gradient.
    """
    low, high = float(values.min()), float(values.max())
    counts, edges = np.histogram(values, HISTOGRAM_BINS, (low, max(high, low + 1e-6)))
    cumulative = np.r_[0, np.cumsum(counts)] / values.size
    return np.asarray(255 * np.interp(values, edges, cumulative), np.float32)


NORMALISATIONS: Mapping[str, Normalisation] = {"none": luma_f32, "retinex": retinex}
