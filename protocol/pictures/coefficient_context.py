"""The context of wavelet coefficients: the inputs of `probability_model`.

The positions of a subband are coded in four passes, one for each corner of every 2 x 2 square, so
the coefficients of a pass have a common context and later passes have neighbours on all sides.  A
band's tiles of `TILE` x `TILE` coefficients have flags, which are coded before the coefficients in
the same way: a tile without the flag has only zeros.

Magnitudes are summed over positions and enter the networks as logarithms.  The signs of a pass are
coded after its magnitudes; their context is the signed values around.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

from shared_model.arrays import Array, Integers, Mask

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


def log_feature(magnitude: int) -> float:
    """A magnitude as the networks take it."""
    return float(LOG_TABLE[min(magnitude, len(LOG_TABLE) - 1)])


@dataclass(frozen=True, slots=True)
class CodingPass:
    """Positions of a grid that are coded together.

    number: index into `PASS_OFFSETS`.
    grid: (h, w).
    rows, columns: (n,) of the positions.
    """

    number: int
    grid: tuple[int, int]
    rows: Integers
    columns: Integers

    @property
    def position_cells(self) -> tuple[Integers, Integers]:
        """Cells 0..POSITION_CELLS - 1 of the positions: (n,) by rows, (n,) by columns."""
        height, width = self.grid
        return self.rows * POSITION_CELLS // height, self.columns * POSITION_CELLS // width

    def subset(self, chosen: Mask) -> "CodingPass":
        """The pass with the positions chosen (n,) alone."""
        return CodingPass(self.number, self.grid, self.rows[chosen], self.columns[chosen])


class CoefficientContext:
    """The values of a grid (h, w) that are known so far, and what predicts them.

    bands: (len(ContextBand), h, w).
    active: (h, w) the positions that are coded.
    tile_flags: (h, w) number of flagged tiles among the nine around a position; zeros while the
        flags themselves are coded.
    Attributes magnitudes, values: the grids of the features of magnitudes and of signs.
    """

    def __init__(self, bands: Integers, active: Mask, tile_flags: Integers) -> None:
        self._active = active
        height, width = self._shape = active.shape
        self._across = width + 2 * PAD
        inside = slice(PAD, PAD + height), slice(PAD, PAD + width)
        padded = height + 2 * PAD, self._across
        magnitudes = np.zeros((len(ContextBand) + 2, *padded), np.int64)
        magnitudes[(slice(1, -1), *inside)] = np.abs(bands)
        magnitudes[(-1, *inside)] = tile_flags
        values = np.zeros((1 + len(ContextBand) - FIRST_SIGNED, *padded), np.int64)
        values[(slice(1, None), *inside)] = bands[FIRST_SIGNED:]
        magnitude_offsets, sign_offsets = context_offsets(height, width)
        self.magnitudes = ContextTerms(magnitudes.ravel(), magnitude_offsets)
        self.values = ContextTerms(values.ravel(), sign_offsets)

    def passes(self) -> Iterator[CodingPass]:
        """Each pass that has active positions; call `set_known` before the next."""
        for number, (down, right) in enumerate(PASS_OFFSETS):
            rows, columns = np.nonzero(self._active[down::2, right::2])
            if len(rows):
                yield CodingPass(number, self._active.shape, 2 * rows + down, 2 * columns + right)

    def set_known(self, coding_pass: CodingPass, values: Integers) -> None:
        """Enter the values (n,) of a pass."""
        indices = (coding_pass.rows + PAD) * self._across + coding_pass.columns + PAD
        self.values.grids[indices] = values
        self.magnitudes.grids[indices] = np.abs(values)

    def magnitude_features(self, coding_pass: CodingPass) -> Array:
        """(n, MAGNITUDE_FEATURES) features of a pass's magnitudes, integers."""
        terms = self.magnitudes.gather(self.indices(coding_pass))
        sums = np.add.reduceat(terms, self.magnitudes.sums.starts, axis=1)
        return np.asarray(LOG_TABLE.take(sums, mode="clip"))

    def sign_features(self, coding_pass: CodingPass) -> Array:
        """(n, SIGN_FEATURES) features of a pass's signs, integers."""
        values = self.values.gather(self.indices(coding_pass))
        return np.asarray(np.sign(values) * LOG_TABLE.take(np.abs(values), mode="clip"))

    def indices(self, coding_pass: CodingPass) -> Integers:
        """(n, 2) index of each position in the padded grid, and of its mirror image."""
        row = (coding_pass.rows + PAD) * self._across + PAD
        mirrored = self._shape[1] - 1 - coding_pass.columns
        return np.array([row + coding_pass.columns, row + mirrored]).T


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


@dataclass(frozen=True, slots=True)
class ContextTerms:
    """Padded grids, all in one flat array, and the sums that are taken of them."""

    grids: Integers
    sums: ContextOffsets

    def gather(self, indices: Integers) -> Integers:
        """(n, terms) the terms of the sums at positions, see `CoefficientContext.indices`."""
        return np.asarray(self.grids.take(indices.take(self.sums.mirrored, 1) + self.sums.offsets))


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


def tile_sums(values: Integers) -> Integers:
    """(..., ceil(h / TILE), ceil(w / TILE)) sums over tiles of values (..., h, w)."""
    *others, height, width = values.shape
    # Faster than `reduceat`.
    rows = np.zeros((*others, -(-height // TILE), width), np.int64)
    for first in range(TILE):
        part = values[..., first::TILE, :]
        rows[..., : part.shape[-2], :] += part
    sums = np.zeros((*rows.shape[:-1], -(-width // TILE)), np.int64)
    for first in range(TILE):
        part = rows[..., first::TILE]
        sums[..., : part.shape[-1]] += part
    return sums
