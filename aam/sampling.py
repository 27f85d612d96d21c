"""Textures sampled from pictures, and their photometric normalisation (thesis 2.4.5)."""

import cv2
import numpy as np

from aam.window import FaceWindow
from encoder.appearance.photometric import NORMALISATIONS
from shared_model.arrays import Single

# Sides of the window in pixels, in terms of the atlas' side: about one pixel per texel.
PIXELS_PER_TEXEL = 2.0
_COLUMNS = 1024
# Textures of less contrast are taken for flat, grey levels.
_LEAST_CONTRAST = 1e-3


def normalised_luma(window: FaceWindow, normalisation: str) -> Single:
    """(side, side) grey levels.  normalisation: "retinex", with equalisation, or "none"."""
    return NORMALISATIONS[normalisation](window.picture)


def window_px(size: int) -> int:
    """Side of the window for textures of `size` texels a side."""
    return round(PIXELS_PER_TEXEL * size)


def sample(luma: Single, positions: Single) -> Single:
    """(k,) bilinear samples of a picture (h, w) at positions (2, k), pixels; borders repeated."""
    count = positions.shape[1]
    padded = np.zeros((2, -(-count // _COLUMNS) * _COLUMNS), np.float32)
    padded[:, :count] = positions
    x, y = padded.reshape(2, -1, _COLUMNS)
    found = cv2.remap(luma, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.ravel()[:count], np.float32)


def zero_mean_unit_variance(texture: Single) -> Single:
    """The texture (k,) less its mean, divided by its standard deviation."""
    centred = texture - texture.mean()
    return np.asarray(centred / max(float(centred.std()), _LEAST_CONTRAST), np.float32)
