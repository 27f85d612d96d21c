"""The context of wavelet coefficients: the inputs of `probability_model`.

The positions of a subband are coded in four passes, one for each corner of every 2 x 2 square, so
the coefficients of a pass have a common context and later passes have neighbours on all sides.  A
band's tiles of `TILE` x `TILE` coefficients have flags, which are coded before the coefficients in
the same way: a tile without the flag has only zeros.

Magnitudes are summed over positions and enter the networks as logarithms.  The signs of a pass are
coded after its magnitudes; their context is the signed values around.
"""

from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache

import numpy as np

from shared_model.arrays import Integers

TILE = 4
# Bands of up to so many coefficients have no tile flags.
SMALL_BAND = 64
# Row and column of the first position of each pass; both step by two.
PASS_OFFSETS = ((0, 0), (1, 1), (0, 1), (1, 0))
# Cells of a picture along each side: the position of a coefficient as the networks take it.
POSITION_CELLS = 16


class ContextBand(IntEnum):
    """Bands that predict a band, at its own resolution.

    Magnitudes, or sums of magnitudes; from `PREVIOUS_PICTURE` on signed values.
    """

    PARENT = 0  # the same orientation, one level coarser
    PARENT_RING = 1  # the eight neighbours of the parent, summed
    OTHER_PARENTS = 2  # the other two orientations, one level coarser, summed
    PREVIOUS_BAND = 3  # the orientation of this level coded before
    SECOND_PREVIOUS_BAND = 4  # the orientation of this level coded before that one
    PREVIOUS_PICTURES = 5  # the same band of all previous pictures of the sequence, summed
    PREVIOUS_PICTURE = 6  # the same band of the previous picture
    LUMA = 7  # of a colour difference: the luma band of its resolution
    FIRST_CHROMA = 8  # of the second colour difference: the same band of the first one


FIRST_SIGNED = int(ContextBand.PREVIOUS_PICTURE)
_WITH_RING = range(ContextBand.PREVIOUS_BAND, ContextBand.LUMA + 1)

# Offsets in rows and columns, at most `PAD` each.
_Steps = Sequence[tuple[int, int]]
PAD = 2
_HERE = [(0, 0)]
_LEFT_RIGHT, _ABOVE_BELOW = [(0, -1), (0, 1)], [(-1, 0), (1, 0)]
_DIAGONAL = [(i, j) for i in (-1, 1) for j in (-1, 1)]
_RING = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
_OUTER_RING = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if max(abs(i), abs(j)) == 2]
# Features of a magnitude: sums over a grid (0 the band itself, then `ContextBand`, then the tile
# flags), whether around the position mirrored at the vertical axis, and the offsets.
_MAGNITUDE_SUMS: list[tuple[int, bool, _Steps]] = [
    *((0, False, steps) for steps in (_LEFT_RIGHT, _ABOVE_BELOW, _DIAGONAL, _OUTER_RING)),
    *((0, True, steps) for steps in (_HERE, _RING)),
    *((grid, False, _HERE) for grid in range(1, len(ContextBand) + 2)),
    *((1 + band, False, _RING) for band in _WITH_RING),
]
# Features of a sign: values of a grid (0 the band itself, then the signed bands of `ContextBand`).
_SIGN_SUMS: list[tuple[int, bool, _Steps]] = [
    *((0, False, [step]) for step in _LEFT_RIGHT + _ABOVE_BELOW + _DIAGONAL),
    *((0, True, [step]) for step in _HERE + _LEFT_RIGHT),
    *((grid, False, _HERE) for grid in (1, 2, 3)),
]
MAGNITUDE_FEATURES, SIGN_FEATURES = len(_MAGNITUDE_SUMS), len(_SIGN_SUMS)
# 16 log2(1 + magnitude), rounded.
LOG_TABLE = np.rint(16 * np.log2(1 + np.arange(1024)))


class ContextOffsets:
    """Where the terms of a table of sums lie, in padded grids of `count` positions each.

    across: width of a padded grid.
    Attributes offsets: (terms,) from a position's index.  mirrored: (terms,) 1 if from the index of
    the mirror image.  starts: (sums,) first term of each sum.
    """

    def __init__(self, sums: Sequence[tuple[int, bool, _Steps]], across: int, count: int) -> None:
        offsets = [[grid * count + i * across + j for i, j in steps] for grid, _, steps in sums]
        self.offsets = np.array([offset for each in offsets for offset in each])
        self.mirrored = np.array([int(mirrored) for _, mirrored, steps in sums for _ in steps])
        self.starts = np.cumsum([0, *map(len, offsets[:-1])])


@lru_cache(maxsize=256)
def context_offsets(height: int, width: int) -> tuple[ContextOffsets, ContextOffsets]:
    """The terms of the features of magnitudes and of signs in a grid (height, width)."""
    across = width + 2 * PAD
    count = (height + 2 * PAD) * across
    magnitudes = ContextOffsets(_MAGNITUDE_SUMS, across, count)
    return magnitudes, ContextOffsets(_SIGN_SUMS, across, count)


def tile_grid(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of the tiles of a band of this shape (h, w)."""
    height, width = shape
    return -(-height // TILE), -(-width // TILE)


def upsample(values: Integers, factor: int, shape: tuple[int, ...]) -> Integers:
    """Values (h, w), each repeated `factor` times along both axes, cropped or padded to `shape`."""
    return crop_or_pad(np.repeat(np.repeat(values, factor, 0), factor, 1), shape)


def crop_or_pad(values: Integers, shape: tuple[int, ...]) -> Integers:
    """Values (h, w) in `shape`: cropped, or padded with zeros at the end."""
    if values.shape == shape:
        return values
    result = np.zeros(shape, np.int64)
    height, width = map(min, shape, values.shape)
    result[:height, :width] = values[:height, :width]
    return result


def box_sum(values: Integers) -> Integers:
    """(h, w) sums over 3 x 3 positions of values (h, w)."""
    height, width = values.shape
    padded = np.zeros((height + 2, width + 2), np.int64)
    padded[1:-1, 1:-1] = values
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
