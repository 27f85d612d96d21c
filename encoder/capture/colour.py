"""Luma of pictures."""

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


Single = NDArray[np.float32]


def in_luma(picture: Picture) -> Picture:
    """(h, w) uint8 luma of a BGR picture (h, w, 3), as PSNR sees it; what is luma stays."""
    if picture.ndim == 2:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def luma(picture: Picture) -> Single:
    """The same as `in_luma`, (h, w) float32."""
    return np.asarray(in_luma(picture), dtype=np.float32)
