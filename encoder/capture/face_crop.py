"""The window of a frame that holds the face, at no higher resolution than the texture has."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from protocol.pictures.picture_codec import to_luma

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# Width of the margin around the points, in terms of their larger extent.
MARGIN = 0.3
# Below this many pixels per texel a window is not scaled down.
MIN_PIXELS_PER_TEXEL = 1.2


@dataclass(frozen=True, slots=True)
class Crop:
    """A window of a frame, scaled down.

    picture: (h, w, 3) uint8 BGR, or (h, w) luma.
    left, top: the window's first column and row in the frame, pixels.
    scale: (2,) pixels of the crop per pixel of the frame, in x and y.
    """

    picture: NDArray[Any]
    left: int
    top: int
    scale: Array

    @property
    def as_luma(self) -> "Crop":
        """The same window with a float32 luma picture (h, w)."""
        if self.picture.ndim == 2:
            return self
        return replace(self, picture=to_luma(self.picture))

    def to_crop_px(self, positions_px: Single) -> Single:
        """Map positions (k, 2) from pixels of the frame to pixels of the crop."""
        corner = np.array([self.left, self.top], np.float32) - np.float32(0.5)
        return np.asarray((positions_px - corner) * self.scale.astype(np.float32) - np.float32(0.5))


def crop_face(frame: Picture, points_px: Array, pixels_per_texel: float) -> Crop:
    """Cut out the window of `frame` that holds the points, at about one pixel per texel.

    frame: (h, w, 3) uint8 BGR.  points_px: (m, >= 2) pixels.
    pixels_per_texel: resolution of the face in the frame.
    """
    low, high = points_px[:, :2].min(0), points_px[:, :2].max(0)
    margin = MARGIN * float((high - low).max())
    height, width = frame.shape[:2]
    left, top = np.clip(np.floor(low - margin), 0, [width - 2, height - 2]).astype(int)
    right, bottom = np.clip(np.ceil(high + margin), [left + 2, top + 2], [width, height]).astype(
        int
    )
    window = frame[top:bottom, left:right]
    if pixels_per_texel <= MIN_PIXELS_PER_TEXEL:
        return Crop(np.ascontiguousarray(window), int(left), int(top), np.ones(2))
    size = np.maximum(np.rint(np.array(window.shape[1::-1]) / pixels_per_texel), 2).astype(int)
    small = cv2.resize(window, tuple(size.tolist()), interpolation=cv2.INTER_AREA)
    scale = size / np.array(window.shape[1::-1])
    return Crop(np.asarray(small, dtype=np.uint8), int(left), int(top), scale)
