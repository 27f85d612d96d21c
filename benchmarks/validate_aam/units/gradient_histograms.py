"""Histograms of a texture's gradients by orientation (Dalal and Triggs 2005).

They say where edges are and how they run, and little of how dark a person's brows or how lit a
cheek is.
"""

from functools import lru_cache

import cv2
import numpy as np

from aam.texture_frame import texture_frame
from shared_model.arrays import Indices, Single

# Cells along a side of the atlas; what counts for one has a standard deviation of half its side.
CELLS = 16
ORIENTATIONS = 6
# Cells of little contrast count for less: this share of the mean gradient is added to theirs.
FLOOR = 0.3


def gradient_histograms(size: int, frame: str, texture: Single) -> Single:
    """(cells x 6,) square root of each orientation's share of the gradients in each cell.

    size, frame: see `texture_frame`, whose k texels the texture (k,) holds.  Edges of opposite sign
    have one orientation.
    """
    texels, (inner, places) = texture_frame(size, frame), _cells(size, frame)
    picture = np.zeros((size, size), np.float32)
    picture[texels.rows, texels.columns] = texture
    across, down = (
        np.asarray(cv2.Sobel(picture, cv2.CV_32F, *order, ksize=1)) * inner / 2
        for order in ((1, 0), (0, 1))
    )
    turn = np.arctan2(down, across) / np.pi % 1 * ORIENTATIONS
    length = np.hypot(across, down)
    # Each gradient counts for the two orientations next to it.
    away = np.abs(turn[..., None] - np.arange(ORIENTATIONS))
    share = np.maximum(1 - np.minimum(away, ORIENTATIONS - away), 0)
    spread = cv2.GaussianBlur(length[..., None] * share, (0, 0), size / CELLS / 2)
    found = np.asarray(spread)[places]
    strength = np.linalg.norm(found, axis=1, keepdims=True)
    found = found / np.maximum(strength + FLOOR * strength.mean(), 1e-6)
    return np.asarray(np.sqrt(found).ravel(), np.float32)


@lru_cache(maxsize=4)
def _cells(size: int, frame: str) -> tuple[Single, tuple[Indices, Indices]]:
    """Which texels (size, size) have all their neighbours, and rows and columns of the cells."""
    texels, cell = texture_frame(size, frame), size // CELLS
    mask = np.zeros((size, size), np.uint8)
    mask[texels.rows, texels.columns] = 1
    inner = np.asarray(cv2.erode(mask, np.ones((3, 3), np.uint8)), np.float32)
    rows, columns = (
        np.arange(each.min() + cell // 2, each.max() + 1, cell)
        for each in (texels.rows, texels.columns)
    )
    chosen = np.nonzero(mask[np.ix_(rows, columns)])
    return inner, (rows[chosen[0]], columns[chosen[1]])
