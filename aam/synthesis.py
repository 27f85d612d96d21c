"""Pictures of what a model makes of its parameters (thesis Fig. 2.15, 2.16 and 2.19)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.model import AppearanceModel
from aam.warps import Warp
from shared_model.arrays import Array, Picture, Single

# Grey level of a texture's mean, grey levels of its standard deviation, outside of the face.
MIDDLE_GREY, CONTRAST_GREY, OUTSIDE_GREY = 120.0, 52.0, 255
# A face fills this share of the height of its picture.
FILLED = 0.9


def face_picture(model: AppearanceModel, warp: Warp, c: Array, side_px: int) -> Picture:
    """(side, side) uint8: the frontal face of combined parameters (M,)."""
    return drawn_texture(warp, model.shape_of(c), model.texture_of(c), side_px)


def drawn_texture(warp: Warp, shape: Array, texture: Single, side_px: int) -> Picture:
    """(side, side) uint8: a texture (k,) on a frontal face of a shape (n,).

    Texels are spread over the pixels about them, which leaves no holes where a face has about as
    many texels as pixels.
    """
    scale = FILLED * side_px / warp.height
    upright = warp.upright(0.0, np.array([0.0, 0.0, np.log(scale)]))
    positions = warp.positions(shape, upright).astype(np.float64)
    positions += (side_px - 1) / 2 - (positions.min(1) + positions.max(1))[:, None] / 2
    grey, weight = np.zeros((side_px, side_px)), np.zeros((side_px, side_px))
    whole = np.floor(positions).astype(int)
    part = positions - whole
    for dx in (0, 1):
        for dy in (0, 1):
            x, y = whole[0] + dx, whole[1] + dy
            share = np.abs(1 - dx - part[0]) * np.abs(1 - dy - part[1])
            inside = (x >= 0) & (x < side_px) & (y >= 0) & (y < side_px)
            np.add.at(grey, (y[inside], x[inside]), (share * texture)[inside])
            np.add.at(weight, (y[inside], x[inside]), share[inside])
    # Pixels between texels take what is near them.
    near = cv2.GaussianBlur(weight, (0, 0), 1.0) + 1e-9
    filled = np.where(
        weight > 0.1, grey / (weight + 1e-9), cv2.GaussianBlur(grey, (0, 0), 1) / near
    )
    return np.where(near > 0.05, as_grey(filled), OUTSIDE_GREY).astype(np.uint8)


def texels_picture(warp: Warp, values: NDArray[np.floating]) -> Picture:
    """(size, size) uint8: values (k,) of texels on their places, mean grey at 0."""
    picture = np.full((warp.size, warp.size), OUTSIDE_GREY, np.uint8)
    picture[warp.rows, warp.columns] = as_grey(values)
    return picture


def as_grey(values: NDArray[np.floating]) -> Picture:
    """Normalised values as grey levels."""
    return np.asarray(np.clip(MIDDLE_GREY + CONTRAST_GREY * values, 0, 255), np.uint8)
