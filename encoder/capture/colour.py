"""Luma (Y' of BT.601) of uint8 pictures, rounded to 8 bits as OpenCV does it.

Luma of float colours, without rounding: `protocol.pictures.picture_codec.to_luma`.
"""

import cv2
import numpy as np

from shared_model.arrays import Picture, Single


def luma_u8(picture: Picture) -> Picture:
    """(h, w) uint8 luma of a picture: (h, w, 3) uint8 BGR, or luma, which is returned itself."""
    if picture.ndim == 2:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def luma_f32(picture: Picture) -> Single:
    """(h, w) float32, the values of `luma_u8`."""
    return np.asarray(luma_u8(picture), dtype=np.float32)
