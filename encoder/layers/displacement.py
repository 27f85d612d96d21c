"""Displacements of the mesh as dense fields at any picture size, and pictures moved by them."""

from functools import lru_cache

import cv2
import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array, Single

# Steps of the fixed point by which a displacement is inverted; it is a contraction.
INVERSION_STEPS = 4


@lru_cache(maxsize=8)
def pixel_grid(shape: tuple[int, int]) -> Single:
    """(h, w, 2) x and y of each pixel; read only."""
    columns, rows = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    grid = np.stack([columns, rows], -1).astype(np.float32)
    grid.flags.writeable = False
    return grid


def dense(motion: Array, size: tuple[int, int], shape: tuple[int, int]) -> Single:
    """(h, w, 2) pixels of a picture of `shape`: a displacement at points evenly over it.

    motion: (rows, columns, 2) source pixels, corner to corner.  size: of the source.
    """
    scaled = motion * (np.array(shape[::-1]) / np.array(size))
    at = _between_points((motion.shape[0], motion.shape[1]), shape)
    return sample(scaled.astype(np.float32), at)


@lru_cache(maxsize=8)
def _between_points(points: tuple[int, int], shape: tuple[int, int]) -> Single:
    """(h, w, 2) where the pixels of a picture are among (rows, columns) points evenly over it."""
    rows, columns = points
    at = (pixel_grid(shape) + 0.5) / np.array(shape[::-1]) * [columns - 1, rows - 1]
    return np.asarray(at, np.float32)


def dot(first: Single, second: Single) -> Single:
    """(k, h, w) the scalar products of vectors (k, h, w, 2) and (h, w, 2)."""
    return _dot(first, second)


@jit
def _dot(first: Single, second: Single) -> Single:
    products = np.empty(first.shape[:3], np.float32)
    for number in range(len(first)):
        for row in range(first.shape[1]):
            for column in range(first.shape[2]):
                products[number, row, column] = (
                    first[number, row, column, 0] * second[row, column, 0]
                    + first[number, row, column, 1] * second[row, column, 1]
                )
    return products


def moved_back(at: Single, coefficients: Array, fields: Single) -> Single:
    """Positions (h, w, 2) less the sum of fields (k, h, w, 2) times their coefficients (k,)."""
    return _moved_back(at, coefficients.astype(np.float32), fields)


@jit
def _moved_back(at: Single, coefficients: Single, fields: Single) -> Single:
    moved = np.empty_like(at)
    for row in range(at.shape[0]):
        total = np.zeros(at.shape[1:], np.float32)
        for number in range(len(coefficients)):
            for column in range(at.shape[1]):
                for axis in range(2):
                    total[column, axis] += coefficients[number] * fields[number, row, column, axis]
        for column in range(at.shape[1]):
            for axis in range(2):
                moved[row, column, axis] = at[row, column, axis] - total[column, axis]
    return moved


def sample(image: Single, at: Single) -> Single:
    """An image (h, w) or (h, w, c) at positions (..., 2), bilinearly; beyond it, its edge."""
    mode, no_map = cv2.BORDER_REPLICATE, np.empty(0, np.float32)
    sampled = cv2.remap(image, at, no_map, cv2.INTER_LINEAR, borderMode=mode)
    return np.asarray(sampled, np.float32)


def origins(displacement: Single) -> Single:
    """(h, w, 2) for each pixel the position that a displacement (h, w, 2) takes there."""
    grid = pixel_grid(displacement.shape[:2])
    at = grid - displacement
    for _ in range(INVERSION_STEPS - 1):
        at = grid - sample(displacement, at)
    return np.asarray(at)
