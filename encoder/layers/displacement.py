"""Displacements of the mesh as dense fields at any picture size, and pictures moved by them."""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Steps of the fixed point by which a displacement is inverted; it is a contraction.
INVERSION_STEPS = 4


def pixel_grid(shape: tuple[int, int]) -> Single:
    """(h, w, 2) x and y of each pixel."""
    columns, rows = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    return np.stack([columns, rows], -1).astype(np.float32)


def dense(motion: Array, size: tuple[int, int], shape: tuple[int, int]) -> Single:
    """(h, w, 2) pixels of a picture of `shape`: a displacement at points evenly over it.

    motion: (rows, columns, 2) source pixels, corner to corner.  size: of the source.
    """
    rows, columns = motion.shape[:2]
    at = (pixel_grid(shape) + 0.5) / np.array(shape[::-1]) * [columns - 1, rows - 1]
    scaled = motion * (np.array(shape[::-1]) / np.array(size))
    return sample(scaled.astype(np.float32), at.astype(np.float32))


def sample(image: Single, at: Single) -> Single:
    """An image (h, w) or (h, w, c) at positions (..., 2), bilinearly; beyond it, its edge."""
    mode = cv2.BORDER_REPLICATE
    sampled = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=mode)
    return np.asarray(sampled, np.float32)


def origins(displacement: Single) -> Single:
    """(h, w, 2) for each pixel the position that a displacement (h, w, 2) takes there."""
    grid = pixel_grid(displacement.shape[:2])
    at = grid - displacement
    for _ in range(INVERSION_STEPS - 1):
        at = grid - sample(displacement, at)
    return np.asarray(at)
