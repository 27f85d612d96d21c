"""Pictures brought to the size that a call has: fitted in with borders, stretched, or reduced."""

from fractions import Fraction

import cv2
import numpy as np

from protocol.sample_aspect import square_size
from shared_model.arrays import Picture

# A picture of a two-way call has at most so many pixels; larger ones are reduced.
MAX_PICTURE_PX = 640 * 480


def letterboxed(picture: Picture, width: int, height: int) -> Picture:
    """A picture (h, w, 3), whole, in one of (height, width, 3) between black borders."""
    if picture.shape[:2] == (height, width):
        return picture
    scale = min(width / picture.shape[1], height / picture.shape[0])
    columns = min(width, max(1, round(scale * picture.shape[1])))
    rows = min(height, max(1, round(scale * picture.shape[0])))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    framed = np.zeros((height, width, 3), np.uint8)
    top, left = (height - rows) // 2, (width - columns) // 2
    fitted = cv2.resize(picture, (columns, rows), interpolation=method)
    framed[top : top + rows, left : left + columns] = fitted
    return framed


def in_square_pixels(picture: Picture, aspect: Fraction) -> Picture:
    """A picture (h, w, 3) of this sample aspect ratio as a call has it."""
    height, width = picture.shape[:2]
    size = square_size(width, height, aspect)
    if size == (width, height):
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def reduced(picture: Picture, max_pixels: int = MAX_PICTURE_PX) -> Picture:
    """The picture with at most so many pixels, its sides even."""
    height, width = picture.shape[:2]
    scale = (max_pixels / (height * width)) ** 0.5
    if scale >= 1:
        return picture
    size = 2 * round(scale * width / 2), 2 * round(scale * height / 2)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
