"""Pictures of a call, whose pixels are square, in the size that its source has."""

import cv2
import numpy as np

from shared_model.arrays import Picture


def in_source_size(picture: Picture, size: tuple[int, int]) -> Picture:
    """A picture (h, w, 3) of a call in the width and height of its source.

    size: see `CallParameters.source_size`.
    """
    if size == (picture.shape[1], picture.shape[0]):
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
