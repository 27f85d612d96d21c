"""How the values of a packet are coded: probabilities from what the packet has shown so far.

Each value has a *table*: the size that the model packet's spreads let expect, in quarter octaves of
the quantiser's step.  Its surroundings correct the table: whether this packet moves more than is
usual, whether the two values before it were zero, and how large the same component was in the
frames it is predicted between.  Nothing is kept from one packet to the next, so a lost packet costs
nothing here; measured on real calls, probabilities that adapt all through the call save no more
than these corrections.  All is integer: both ends run the same code and find the same tables.
"""

from bisect import bisect
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import WHOLE

# fmt: off
# Probability, of 65536, that a value is zero, and that its size goes no further, for a Laplacian
# whose scale is 2 ** (k / 4) steps, k = -20, -19, ... 28.
_ZERO = (
    65488, 65488, 65488, 65488, 65488, 65488, 65462, 65319, 64997, 64378, 63336, 61761,
    59591, 56826, 53528, 49806, 45797, 41644, 37484, 33429, 29569, 25966, 22659, 19665,
    16986, 14612, 12527, 10707, 9129, 7766, 6595, 5592, 4735, 4006, 3385, 2858,
    2412, 2034, 1715, 1445, 1217, 1025, 863, 727, 612, 515, 433, 364,
    306,
)
_STOP = (
    65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65457, 65307, 64973,
    64336, 63268, 61662, 59461, 56667, 53344, 49603, 45583, 41427, 37269, 33222, 29374,
    25786, 22495, 19517, 16855, 14497, 12425, 10619, 9052, 7701, 6539, 5544, 4694,
    3971, 3355, 2833, 2391, 2016, 1700, 1432, 1207, 1016, 855, 720, 606,
    510,
)
# Mean size of such a value, in 1/256.
_MEAN = (
    0, 0, 0, 0, 0, 0, 0, 1, 2, 5, 9, 15,
    24, 35, 50, 68, 89, 115, 145, 180, 222, 272, 330, 400,
    482, 580, 695, 833, 996, 1190, 1421, 1695, 2021, 2409, 2870, 3418,
    4069, 4845, 5767, 6862, 8167, 9715, 11562, 13746, 16359, 19468, 23148, 27531,
    32743,
)
# fmt: on
TABLES = len(_ZERO)
LOWEST_TABLE = -20

# Corrections of the table, found on calls of four people and judged on those left out: how much the
# packet has moved over what was expected, bounds in 1/256 in steps of half an octave;
_RATIOS = (76, 108, 152, 215, 304, 431, 609, 861)
_BY_RATIO = (-4, -4, -2, -2, -1, 0, 0, 1, 3)
# how many of the last two values were not zero; the size of the component in the frames around.
_BY_NEIGHBOURS = (-1, 1, 1)
_BY_PARENTS = (0, 0, 1)

# Sizes up to this are counted out; what is beyond has Elias' gamma code and `_ESCAPE_LOW` low bits.
UNARY = 40
_ESCAPE_LOW = 4
_ESCAPE_TOP = 12


class BitCoder(Protocol):
    """A range encoder, or a range decoder, which ignores the bit it is given for its own."""

    def code_bit(self, bit: int, zero: int) -> int:
        """Code `bit`, which is 0 with probability `zero` / 65536, and return it."""


class Surroundings:
    """What a packet has shown so far.

    For each frame call `start_frame`, then for each value `table`, and `saw` once it is known.
    """

    def __init__(self) -> None:
        self._seen = self._expected = 0
        self._frame_seen = self._frame_expected = 0
        self._last = self._last_but_one = 0

    def start_frame(self) -> None:
        """The values that follow are another frame's."""
        self._seen += self._frame_seen
        self._expected += self._frame_expected
        self._frame_seen = self._frame_expected = self._last = self._last_but_one = 0

    def table(self, expected: int, parents: int) -> int:
        """The table 0..TABLES - 1 of the next value.

        expected: its table without surroundings, 0..TABLES - 1.
        parents: sum of the sizes of the same component in the frames it is predicted between.
        """
        moved = 3 * self._frame_seen + self._seen + 1
        usual = 3 * self._frame_expected + self._expected + 256
        corrected = (
            expected
            + _BY_RATIO[bisect(_RATIOS, (moved << 16) // usual)]
            + _BY_NEIGHBOURS[self._last + self._last_but_one]
            + _BY_PARENTS[min(2, parents)]
        )
        return min(max(corrected, 0), TABLES - 1)

    def saw(self, expected: int, size: int) -> None:
        """The value whose table was `expected` has this size."""
        self._frame_seen += size
        self._frame_expected += _MEAN[expected]
        self._last_but_one, self._last = self._last, int(size > 0)


def tables_around(
    expected: NDArray[np.int64], parents: NDArray[np.int64], sizes: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(frames, n) the table of each value of a packet, as `Surroundings` has them, all at once.

    expected, parents: (frames, n) as there.  sizes: (frames, n) of the values themselves.
    """
    moved, usual = _before(sizes) + 1, _before(np.take(_MEAN, expected)) + 256
    ratio = np.searchsorted(_RATIOS, (moved << 16) // usual, side="right")
    some = np.zeros((len(sizes), sizes.shape[1] + 2), np.int64)
    some[:, 2:] = sizes > 0
    found = (
        expected
        + np.take(_BY_RATIO, ratio)
        + np.take(_BY_NEIGHBOURS, some[:, :-2] + some[:, 1:-1])
        + np.take(_BY_PARENTS, np.minimum(parents, 2))
    )
    return np.asarray(np.clip(found, 0, TABLES - 1))


def _before(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """(frames, n) the sum of what comes before each value, its own frame's threefold."""
    own = sizes.cumsum(1)
    whole = own[:, -1:]
    return np.asarray(3 * (own - sizes) + whole.cumsum(0) - whole)


def code_value(coder: BitCoder, value: int, table: int) -> int:
    """Code `value` by `table`; a decoder ignores `value`.  Returns the value coded.

    Raises `ValueError` if a decoder reads a size that no encoder writes.
    """
    size = abs(value)
    if not coder.code_bit(int(size > 0), _ZERO[table]):
        return 0
    negative = coder.code_bit(int(value < 0), WHOLE // 2)
    stop, reached = _STOP[table], 1
    while reached <= UNARY and coder.code_bit(int(size > reached), stop):
        reached += 1
    if reached > UNARY:
        reached += _code_escape(coder, size - reached)
    return -reached if negative else reached


def code_bits(coder: BitCoder, value: int, count: int) -> int:
    """Code the `count` lowest bits of `value`, all as likely as not, and return them."""
    coded = 0
    for place in reversed(range(count)):
        coded = coded << 1 | coder.code_bit(value >> place & 1, WHOLE // 2)
    return coded


def code_gamma(coder: BitCoder, value: int, longest: int) -> int:
    """Elias' gamma code of `value` >= 0, at most 2 ** (`longest` + 1) - 2; returns the value coded.

    A decoder ignores `value`.  Raises `ValueError` if it is larger.
    """
    high, length = value + 1, 0
    while coder.code_bit(int(high >> length > 1), WHOLE // 2):
        length += 1
        if length > longest:
            raise ValueError("a value is too large")
    return (1 << length | code_bits(coder, high, length)) - 1


def _code_escape(coder: BitCoder, excess: int) -> int:
    """The gamma code of `excess` >= 0 in units of 2 ** `_ESCAPE_LOW`, then its low bits."""
    above = code_gamma(coder, excess >> _ESCAPE_LOW, _ESCAPE_TOP)
    return above << _ESCAPE_LOW | code_bits(coder, excess, _ESCAPE_LOW)


MAX_SIZE = UNARY + (((2 << _ESCAPE_TOP) - 1) << _ESCAPE_LOW)


def value_bits() -> NDArray[np.float64]:
    """(TABLES, UNARY + 1) bits that a value of each size costs under each table."""
    zero, stop = np.array(_ZERO) / WHOLE, np.array(_STOP) / WHOLE
    costs = np.empty((TABLES, UNARY + 1))
    costs[:, 0] = -np.log2(zero)
    further = np.arange(UNARY) * -np.log2(1 - stop)[:, None]
    costs[:, 1:] = (1 - np.log2(1 - zero) - np.log2(stop))[:, None] + further
    return costs
