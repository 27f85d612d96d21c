"""Coding of quantised prediction residuals by context-dependent Laplacian tables.

A *table* holds the probabilities of a Laplacian distribution; its index is the scale in quarter
octaves of the quantiser's step.  The model packet gives a base table for each value.  The context
within the packet corrects it: the magnitudes so far against their expectation, the two preceding
values, and the magnitudes of the same component in the frames that predict this one.  The context
starts anew in each packet, so a lost packet does not affect the decoding of the next.  The
arithmetic is in integers; both ends run the same code and find the same tables.
"""

from bisect import bisect

import numpy as np

from protocol.entropy.integer_codes import code_bits, code_exp_golomb
from protocol.entropy.range_coder import PROBABILITY_ONE, BitCoder
from shared_model.arrays import Array, Integers

# fmt: off
# Of a Laplacian with scale 2 ** (k / 4) steps, k = -20, -19, ... 28, in 1/65536: the probability
# that a value is zero, and that a magnitude of at least m is m.
ZERO_PROBABILITIES = (
    65488, 65488, 65488, 65488, 65488, 65488, 65462, 65319, 64997, 64378, 63336, 61761,
    59591, 56826, 53528, 49806, 45797, 41644, 37484, 33429, 29569, 25966, 22659, 19665,
    16986, 14612, 12527, 10707, 9129, 7766, 6595, 5592, 4735, 4006, 3385, 2858,
    2412, 2034, 1715, 1445, 1217, 1025, 863, 727, 612, 515, 433, 364,
    306,
)
STOP_PROBABILITIES = (
    65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65457, 65307, 64973,
    64336, 63268, 61662, 59461, 56667, 53344, 49603, 45583, 41427, 37269, 33222, 29374,
    25786, 22495, 19517, 16855, 14497, 12425, 10619, 9052, 7701, 6539, 5544, 4694,
    3971, 3355, 2833, 2391, 2016, 1700, 1432, 1207, 1016, 855, 720, 606,
    510,
)
# Mean magnitude of such a value, in 1/256.
MEAN_MAGNITUDES = (
    0, 0, 0, 0, 0, 0, 0, 1, 2, 5, 9, 15,
    24, 35, 50, 68, 89, 115, 145, 180, 222, 272, 330, 400,
    482, 580, 695, 833, 996, 1190, 1421, 1695, 2021, 2409, 2870, 3418,
    4069, 4845, 5767, 6862, 8167, 9715, 11562, 13746, 16359, 19468, 23148, 27531,
    32743,
)
# fmt: on
TABLES = len(ZERO_PROBABILITIES)
LOWEST_TABLE = -20

# Corrections of the table's index, fitted to calls of four people with cross-validation.
# By the ratio of the magnitudes so far to their expectation; bounds in 1/256, half an octave apart.
RATIO_BOUNDS = (76, 108, 152, 215, 304, 431, 609, 861)
RATIO_CORRECTIONS = (-4, -4, -2, -2, -1, 0, 0, 1, 3)
# By how many of the two preceding values of the frame are not zero.
PRECEDING_CORRECTIONS = (-1, 1, 1)
# By the sum of the component's magnitudes in the two reference frames: 0, 1, 2 or more.
REFERENCE_CORRECTIONS = (0, 0, 1)

# Magnitudes up to this have a unary code; the excess of larger ones has an Exp-Golomb code of its
# high bits, followed by `ESCAPE_LOW` low bits.
UNARY_LIMIT = 40
ESCAPE_LOW = 4
ESCAPE_TOP = 12


class ValueContext:
    """The context of the values of one packet.

    For each frame call `start_frame`, then for each value `table`, and `update` with the value.
    """

    def __init__(self) -> None:
        # Sums over the frames before this one, then over this one.
        self._magnitudes = self._expected = 0
        self._frame_magnitudes = self._frame_expected = 0
        # Whether the two preceding values of the frame are not zero.
        self._last = self._last_but_one = 0

    def start_frame(self) -> None:
        """Begin the next frame of the packet."""
        self._magnitudes += self._frame_magnitudes
        self._expected += self._frame_expected
        self._frame_magnitudes = self._frame_expected = self._last = self._last_but_one = 0

    def table(self, base_table: int, reference_magnitude: int) -> int:
        """The table 0..TABLES - 1 of the next value.

        base_table: its table without context, 0..TABLES - 1.
        reference_magnitude: sum of the component's magnitudes in the frames that predict this one.
        """
        observed = 3 * self._frame_magnitudes + self._magnitudes + 1
        expected = 3 * self._frame_expected + self._expected + 256
        corrected = (
            base_table
            + RATIO_CORRECTIONS[bisect(RATIO_BOUNDS, (observed << 16) // expected)]
            + PRECEDING_CORRECTIONS[self._last + self._last_but_one]
            + REFERENCE_CORRECTIONS[min(2, reference_magnitude)]
        )
        return min(max(corrected, 0), TABLES - 1)

    def update(self, base_table: int, magnitude: int) -> None:
        """Add the value that was coded after `table(base_table, ...)`."""
        self._frame_magnitudes += magnitude
        self._frame_expected += MEAN_MAGNITUDES[base_table]
        self._last_but_one, self._last = self._last, int(magnitude > 0)


def context_tables(
    base_tables: Integers,
    reference_magnitudes: Integers,
    magnitudes: Integers,
) -> Integers:
    """(frames, n) the tables that `ValueContext` gives for the values of a packet, all at once.

    base_tables, reference_magnitudes: (frames, n), see `ValueContext.table`.
    magnitudes: (frames, n) of the values themselves.
    """
    observed = _weighted_sums(magnitudes) + 1
    expected = _weighted_sums(np.take(MEAN_MAGNITUDES, base_tables)) + 256
    ratio = np.searchsorted(RATIO_BOUNDS, (observed << 16) // expected, side="right")
    nonzero = np.zeros((len(magnitudes), magnitudes.shape[1] + 2), np.int64)
    nonzero[:, 2:] = magnitudes > 0
    corrected = (
        base_tables
        + np.take(RATIO_CORRECTIONS, ratio)
        + np.take(PRECEDING_CORRECTIONS, nonzero[:, :-2] + nonzero[:, 1:-1])
        + np.take(REFERENCE_CORRECTIONS, np.minimum(reference_magnitudes, 2))
    )
    return np.asarray(np.clip(corrected, 0, TABLES - 1))


def _weighted_sums(values: Integers) -> Integers:
    """(frames, n) the sum of all values before each; those of the same frame count three times."""
    own = values.cumsum(1)
    whole = own[:, -1:]
    return np.asarray(3 * (own - values) + whole.cumsum(0) - whole)


def code_value(coder: BitCoder, value: int, table: int) -> int:
    """Code `value` by `table`; a decoder ignores `value`.  Returns the value coded.

    Raises `ValueError` if a decoder reads a magnitude beyond the limits of the escape code.
    """
    magnitude = abs(value)
    if not coder.code_bit(int(magnitude > 0), ZERO_PROBABILITIES[table]):
        return 0
    negative = coder.code_bit(int(value < 0), PROBABILITY_ONE // 2)
    stop, reached = STOP_PROBABILITIES[table], 1
    while reached <= UNARY_LIMIT and coder.code_bit(int(magnitude > reached), stop):
        reached += 1
    if reached > UNARY_LIMIT:
        reached += _code_escape(coder, magnitude - reached)
    return -reached if negative else reached


def _code_escape(coder: BitCoder, excess: int) -> int:
    """Code `excess` >= 0: its high bits by Exp-Golomb, then the `ESCAPE_LOW` lowest bits."""
    high = code_exp_golomb(coder, excess >> ESCAPE_LOW, ESCAPE_TOP)
    return high << ESCAPE_LOW | code_bits(coder, excess, ESCAPE_LOW)


MAX_MAGNITUDE = UNARY_LIMIT + (((2 << ESCAPE_TOP) - 1) << ESCAPE_LOW)


def value_bits() -> Array:
    """(TABLES, UNARY_LIMIT + 1) bits that a value of each magnitude takes by each table."""
    zero, stop = (
        np.array(ZERO_PROBABILITIES) / PROBABILITY_ONE,
        np.array(STOP_PROBABILITIES) / PROBABILITY_ONE,
    )
    bits = np.empty((TABLES, UNARY_LIMIT + 1))
    bits[:, 0] = -np.log2(zero)
    further = np.arange(UNARY_LIMIT) * -np.log2(1 - stop)[:, None]
    bits[:, 1:] = (1 - np.log2(1 - zero) - np.log2(stop))[:, None] + further
    return bits
