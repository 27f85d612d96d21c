"""What is known around wavelet coefficients before they are coded: input of `probability_model`.

The places of a subband are coded in four turns, the corners of every 2 x 2 square one after the
other, so that all of one turn are foretold together, later ones from all sides.  Before them come
flags of tiles of `TILE` x `TILE` coefficients, in the same way: is there anything in it at all?

Sizes are summed over a place or over the ring around it, and enter as their logarithms.  Signs are
coded after the sizes of a turn, by the signed values around.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

TILE = 4
# Bands of no more coefficients have no flags of tiles.
SMALL_BAND = 64
# Rows and columns from which the places of each turn start; all step by two.
PASS_OFFSETS = ((0, 0), (1, 1), (0, 1), (1, 0))
# Places of a picture, by rows and by columns.
POSITION_CELLS = 16


class ContextBand(IntEnum):
    """Other bands that go with a band, at its own density: sizes, from `LAST_PICTURE` on values."""

    PARENT = 0
    PARENT_RING = 1
    OTHER_PARENTS = 2
    PREVIOUS_BAND = 3
    SECOND_PREVIOUS_BAND = 4
    PREVIOUS_PICTURES = 5
    PREVIOUS_PICTURE = 6
    LUMA = 7
    FIRST_CHROMA = 8


# The first of the signed ones.
FIRST_SIGNED = int(ContextBand.PREVIOUS_PICTURE)
_WITH_RING = range(ContextBand.PREVIOUS_BAND, ContextBand.LUMA + 1)

# Steps in rows and columns to what is around a place, at most `PAD` away.
_Steps = Sequence[tuple[int, int]]
PAD = 2
_HERE = [(0, 0)]
_LEFT_RIGHT, _ABOVE_BELOW = [(0, -1), (0, 1)], [(-1, 0), (1, 0)]
_DIAGONAL = [(i, j) for i in (-1, 1) for j in (-1, 1)]
_RING = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
_OUTER_RING = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if max(abs(i), abs(j)) == 2]
# Sums that foretell sizes: grid 0 is the band itself, then come the sources, then the flags of
# tiles; whether it is taken on the other side of the face; and which places.
_MAGNITUDE_SUMS: list[tuple[int, bool, _Steps]] = [
    *((0, False, steps) for steps in (_LEFT_RIGHT, _ABOVE_BELOW, _DIAGONAL, _OUTER_RING)),
    *((0, True, steps) for steps in (_HERE, _RING)),
    *((grid, False, _HERE) for grid in range(1, len(ContextBand) + 2)),
    *((1 + source, False, _RING) for source in _WITH_RING),
]
# Values that foretell signs: grid 0 is the band itself, then come the signed sources.
_SIGN_SUMS: list[tuple[int, bool, _Steps]] = [
    *((0, False, [step]) for step in _LEFT_RIGHT + _ABOVE_BELOW + _DIAGONAL),
    *((0, True, [step]) for step in _HERE + _LEFT_RIGHT),
    *((grid, False, _HERE) for grid in (1, 2, 3)),
]
MAGNITUDE_FEATURES, SIGN_FEATURES = len(_MAGNITUDE_SUMS), len(_SIGN_SUMS)
# Sixteenths of an octave above 1.
LOG_TABLE = np.rint(16 * np.log2(1 + np.arange(1024)))


def log_feature(size: int) -> float:
    """A size as it enters a network."""
    return float(LOG_TABLE[min(size, len(LOG_TABLE) - 1)])


@dataclass(frozen=True, slots=True)
class CodingPass:
    """Places (n,) rows and columns of a grid (h, w) that are coded together."""

    number: int
    grid: tuple[int, int]
    rows: Integers
    columns: Integers

    @property
    def cells(self) -> tuple[Integers, Integers]:
        """Where in the picture they are, 0..CELLS - 1 by rows and by columns."""
        return self.rows * POSITION_CELLS // self.grid[
            0
        ], self.columns * POSITION_CELLS // self.grid[1]

    def subset(self, chosen: Bools) -> "CodingPass":
        """Only some of the places."""
        return CodingPass(self.number, self.grid, self.rows[chosen], self.columns[chosen])


class CoefficientContext:
    """A grid (h, w) of values that become known turn by turn.

    sources: (len(Source), h, w); from `LAST_PICTURE` on they may be negative.
    active: (h, w) the places that are coded.  busy: (h, w) flags of tiles around.
    sizes, values: what is known of either so far.
    """

    def __init__(self, sources: Integers, active: Bools, busy: Integers) -> None:
        self._active = active
        height, width = self._shape = active.shape
        self._across = width + 2 * PAD
        inside = slice(PAD, PAD + height), slice(PAD, PAD + width)
        wide = height + 2 * PAD, self._across
        sizes = np.zeros((len(ContextBand) + 2, *wide), np.int64)
        sizes[(slice(1, -1), *inside)] = np.abs(sources)
        sizes[(-1, *inside)] = busy
        values = np.zeros((1 + len(ContextBand) - FIRST_SIGNED, *wide), np.int64)
        values[(slice(1, None), *inside)] = sources[FIRST_SIGNED:]
        of_sizes, of_signs = context_offsets(height, width)
        self.magnitudes, self.values = (
            ContextTerms(sizes.ravel(), of_sizes),
            ContextTerms(values.ravel(), of_signs),
        )

    def passes(self) -> Iterator[CodingPass]:
        """Each turn's places; call `learn` before the next."""
        for number, (down, right) in enumerate(PASS_OFFSETS):
            rows, columns = np.nonzero(self._active[down::2, right::2])
            if len(rows):
                yield CodingPass(number, self._active.shape, 2 * rows + down, 2 * columns + right)

    def set_known(self, turn: CodingPass, values: Integers) -> None:
        """The values (n,) of a turn's places."""
        places = (turn.rows + PAD) * self._across + turn.columns + PAD
        self.values.grids[places] = values
        self.magnitudes.grids[places] = np.abs(values)

    def magnitude_features(self, turn: CodingPass) -> Array:
        """(n, SIZE_FEATURES) what is known of a turn's sizes, integers."""
        terms = self.magnitudes.at(self.places(turn))
        sums = np.add.reduceat(terms, self.magnitudes.sums.starts, axis=1)
        return np.asarray(LOG_TABLE.take(sums, mode="clip"))

    def sign_features(self, turn: CodingPass) -> Array:
        """(n, SIGN_FEATURES) what is known of a turn's signs, integers."""
        values = self.values.at(self.places(turn))
        return np.asarray(np.sign(values) * LOG_TABLE.take(np.abs(values), mode="clip"))

    def places(self, turn: CodingPass) -> Integers:
        """(n, 2) each place in the padded grid, and that on the other side of the face."""
        row = (turn.rows + PAD) * self._across + PAD
        return np.array([row + turn.columns, row + self._shape[1] - 1 - turn.columns]).T


class ContextOffsets:
    """Where to look for what sums consist of, in padded grids of so many places, one by one.

    offsets: (terms,) from a place.  sides: (terms,) 1 from that on the other side of the face.
    starts: (sums,) the first term of each.
    """

    def __init__(self, sums: Sequence[tuple[int, bool, _Steps]], across: int, places: int) -> None:
        offsets = [[grid * places + i * across + j for i, j in steps] for grid, _, steps in sums]
        self.offsets = np.array([offset for each in offsets for offset in each])
        self.sides = np.array([int(other) for _, other, steps in sums for _ in steps])
        self.starts = np.cumsum([0, *map(len, offsets[:-1])])


@dataclass(frozen=True, slots=True)
class ContextTerms:
    """Padded grids, all in one array, and the sums that are taken of them."""

    grids: Integers
    sums: ContextOffsets

    def at(self, places: Integers) -> Integers:
        """(n, terms) what stands around places (n, 2)."""
        return np.asarray(self.grids.take(places.take(self.sums.sides, 1) + self.sums.offsets))


@lru_cache(maxsize=256)
def context_offsets(height: int, width: int) -> tuple[ContextOffsets, ContextOffsets]:
    """What foretells sizes and signs in a grid of this size, padded by `PAD` on all sides."""
    across = width + 2 * PAD
    places = (height + 2 * PAD) * across
    return ContextOffsets(_MAGNITUDE_SUMS, across, places), ContextOffsets(
        _SIGN_SUMS, across, places
    )


def upsample(sizes: Integers, times: int, shape: tuple[int, ...]) -> Integers:
    """Sizes at so many times the density, in `shape`."""
    return crop_or_pad(np.repeat(np.repeat(sizes, times, 0), times, 1), shape)


def crop_or_pad(values: Integers, shape: tuple[int, ...]) -> Integers:
    """Values in `shape`: cut off, or zeros beyond their end."""
    if values.shape == shape:
        return values
    found = np.zeros(shape, np.int64)
    height, width = map(min, shape, values.shape)
    found[:height, :width] = values[:height, :width]
    return found


def box_sum(sizes: Integers) -> Integers:
    """Sums (h, w) over 3 x 3 places."""
    height, width = sizes.shape
    wide = np.zeros((height + 2, width + 2), np.int64)
    wide[1:-1, 1:-1] = sizes
    rows = wide[:-2] + wide[1:-1] + wide[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])


def tile_sums(sizes: Integers) -> Integers:
    """Sums (..., ceil(h / TILE), ceil(w / TILE)) of sizes (..., h, w)."""
    height, width = sizes.shape[-2:]
    rows, columns = range(0, height, TILE), range(0, width, TILE)
    return np.asarray(np.add.reduceat(np.add.reduceat(sizes, rows, -2), columns, -1))
