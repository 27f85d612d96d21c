"""The window of a frame that holds the face, at no higher resolution than the texture has."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.pictures.picture_codec import to_luma
from runtime.area_resize import area_resized
from runtime.image_ops import hull_mask
from shared_model.arrays import Array, Mask, Picture, Single

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
    hidden: (h, w) where something, as a hand, hides the face; None: nowhere.
    """

    picture: NDArray[Any]
    left: int
    top: int
    scale: Array
    hidden: Mask | None = None

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

    def to_frame_px(self, positions_px: Array) -> Array:
        """Map positions (k, 2) from pixels of the crop to pixels of the frame."""
        return np.asarray((positions_px + 0.5) / self.scale + [self.left, self.top] - 0.5)

    def hiding(self, outlines_px: Sequence[Array]) -> "Crop":
        """The same with what lies within these convex outlines (k, 2), pixels of the frame, hidden.

        It is the same object if nothing does.
        """
        shape = self.picture.shape[:2]
        hidden = np.zeros(shape, bool)
        for outline in outlines_px:
            hidden |= hull_mask(self.to_crop_px(outline.astype(np.float32)), shape) > 0
        return replace(self, hidden=hidden) if hidden.any() else self

    def shows(self, positions_px: Single) -> Mask:
        """(k,) whether nothing hides the face at positions (k, 2), pixels of the crop."""
        if self.hidden is None:
            return np.ones(len(positions_px), bool)
        height, width = self.hidden.shape
        column, row = np.rint(np.nan_to_num(positions_px)).astype(np.intp).T
        return np.asarray(~self.hidden[row.clip(0, height - 1), column.clip(0, width - 1)])


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
    small = area_resized(window, (int(size[0]), int(size[1])))
    scale = size / np.array(window.shape[1::-1])
    return Crop(small, int(left), int(top), scale)


def crop_window(frame: Picture, window: tuple[int, int, int], longest: int) -> Crop:
    """What a frame (h, w, 3) uint8 BGR shows of a square window, its longer side at most `longest`.

    window: left, top, side, pixels; it may leave the frame.
    """
    left, top, side = window
    height, width = frame.shape[:2]
    begin = np.clip([left, top], 0, [width - 1, height - 1])
    end = np.clip([left + side, top + side], begin + 1, [width, height])
    shown = frame[begin[1] : end[1], begin[0] : end[0]]
    ratio = min(1.0, longest / max(shown.shape[:2]))
    size = np.maximum(np.rint(ratio * np.array(shown.shape[1::-1])), 1).astype(int)
    small = area_resized(shown, (int(size[0]), int(size[1])))
    scale = size / np.array(shown.shape[1::-1])
    return Crop(small, int(begin[0]), int(begin[1]), scale)
