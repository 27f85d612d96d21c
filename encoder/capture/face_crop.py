"""The part of a picture around the face, no larger than the texture can use."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from protocol.pictures.picture_codec import to_luma

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

MARGIN = 0.3


@dataclass(frozen=True, slots=True)
class Crop:
    """A window on a frame, shrunk.

    picture: (h, w, 3) uint8 BGR, or (h, w) luma.
    left, top: its corner in the frame, pixels.
    scale: its pixels per pixel of the frame, (2,).
    """

    picture: NDArray[Any]
    left: int
    top: int
    scale: Array

    @property
    def grey(self) -> "Crop":
        """The same in luma."""
        if self.picture.ndim == 2:
            return self
        return replace(self, picture=to_luma(self.picture))

    def from_frame(self, positions_px: Single) -> Single:
        """Positions (k, 2) in the frame to positions in the crop, pixels."""
        corner = np.array([self.left, self.top], np.float32) - np.float32(0.5)
        return np.asarray((positions_px - corner) * self.scale.astype(np.float32) - np.float32(0.5))


def crop_face(frame: Picture, points_px: Array, pixels_per_texel: float) -> Crop:
    """The window on `frame` that holds `points_px` (m, >= 2), at about one pixel per texel."""
    low, high = points_px[:, :2].min(0), points_px[:, :2].max(0)
    margin = MARGIN * float((high - low).max())
    height, width = frame.shape[:2]
    left, top = np.clip(np.floor(low - margin), 0, [width - 2, height - 2]).astype(int)
    right, bottom = np.clip(np.ceil(high + margin), [left + 2, top + 2], [width, height]).astype(
        int
    )
    window = frame[top:bottom, left:right]
    if pixels_per_texel <= 1.2:
        return Crop(np.ascontiguousarray(window), int(left), int(top), np.ones(2))
    size = np.maximum(np.rint(np.array(window.shape[1::-1]) / pixels_per_texel), 2).astype(int)
    small = cv2.resize(window, tuple(size.tolist()), interpolation=cv2.INTER_AREA)
    scale = size / np.array(window.shape[1::-1])
    return Crop(np.asarray(small, dtype=np.uint8), int(left), int(top), scale)
