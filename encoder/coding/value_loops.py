"""Values of a frame packet rounded and coded in compiled loops.

They do what `protocol.frames.value_coding` and `payload_coding` do value by value; the context is a
`ValueContext` as an array.
"""

import numpy as np

from encoder.picture_coding.symbol_writing import Decisions, list_exp_golomb
from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.frames.value_coding import (
    ESCAPE_LOW,
    ESCAPE_TOP,
    MAX_MAGNITUDE,
    MEAN_MAGNITUDES,
    PRECEDING_CORRECTIONS,
    RATIO_BOUNDS,
    RATIO_CORRECTIONS,
    REFERENCE_CORRECTIONS,
    STOP_PROBABILITIES,
    TABLES,
    UNARY_LIMIT,
    ZERO_PROBABILITIES,
)
from runtime.jit import jit
from shared_model.arrays import Array, Integers

# Fields of a context: sums over the frames before this one, over this one, and whether the two
# preceding values of the frame are not zero.
_MAGNITUDES, _EXPECTED, _FRAME_MAGNITUDES, _FRAME_EXPECTED, _LAST, _LAST_BUT_ONE = range(6)
_FIELDS = 6
_ZEROS, _STOPS = np.array(ZERO_PROBABILITIES), np.array(STOP_PROBABILITIES)
_MEANS = np.array(MEAN_MAGNITUDES)
_BOUNDS, _BY_RATIO = np.array(RATIO_BOUNDS), np.array(RATIO_CORRECTIONS)
_BY_PRECEDING, _BY_REFERENCE = np.array(PRECEDING_CORRECTIONS), np.array(REFERENCE_CORRECTIONS)
_EVEN = PROBABILITY_ONE // 2
# Decisions of a value, at most: unary, sign, and those of the escape code.
_LONGEST = UNARY_LIMIT + 2 + 2 * ESCAPE_TOP + 1 + ESCAPE_LOW


def new_context() -> Integers:
    """The context of the first value of a packet."""
    return np.zeros(_FIELDS, np.int64)


def value_decisions(values: Integers, tables: Integers, references: Integers) -> Decisions:
    """The decisions that code the values (frames, n) of a packet, in coding order.

    tables, references: (frames, n), see `ValueContext.table`.
    """
    decisions = np.zeros((2, _LONGEST * values.size), np.int64)
    # One layout, so that the loop is compiled once.
    values, tables, references = map(np.ascontiguousarray, (values, tables, references))
    count = _list_values(values, tables, references, new_context(), decisions)
    bits, zeros = decisions[:, :count]
    return bits, zeros


@jit
def round_adaptively(
    sizes: Array,
    tables: Integers,
    references: Integers,
    bits: Array,
    lagrangian: float,
    context: Integers,
) -> Integers:
    """(n,) magnitudes that minimise squared distance to `sizes` (n,) + Lagrangian * bits.

    tables, references: (n,) see `ValueContext.table`.  bits: see `value_coding.value_bits`.
    context: updated by the frame's values.
    """
    _start_frame(context)
    chosen = np.zeros(len(sizes), np.int64)
    for k in range(len(sizes)):
        size = sizes[k]
        nearest = min(int(np.rint(size)), MAX_MAGNITUDE)
        if nearest:
            row = bits[_table(context, tables[k], references[k])]
            best, least = nearest, _cost(nearest, size, row, lagrangian)
            for magnitude in (nearest - 1, 0):
                cost = _cost(magnitude, size, row, lagrangian)
                if cost < least:
                    best, least = magnitude, cost
            chosen[k] = best
        _update(context, tables[k], chosen[k])
    return chosen


@jit
def _cost(magnitude: int, size: float, bits: Array, lagrangian: float) -> float:
    error = size - magnitude
    return float(error * error + lagrangian * bits[min(magnitude, UNARY_LIMIT)])


@jit
def _start_frame(context: Integers) -> None:
    context[_MAGNITUDES] += context[_FRAME_MAGNITUDES]
    context[_EXPECTED] += context[_FRAME_EXPECTED]
    context[_FRAME_MAGNITUDES:] = 0


@jit
def _table(context: Integers, base_table: int, reference: int) -> int:
    observed = 3 * context[_FRAME_MAGNITUDES] + context[_MAGNITUDES] + 1
    expected = 3 * context[_FRAME_EXPECTED] + context[_EXPECTED] + 256
    ratio, place = (observed << 16) // expected, 0
    while place < len(_BOUNDS) and _BOUNDS[place] <= ratio:
        place += 1
    corrected = (
        base_table
        + _BY_RATIO[place]
        + _BY_PRECEDING[context[_LAST] + context[_LAST_BUT_ONE]]
        + _BY_REFERENCE[min(2, reference)]
    )
    return int(min(max(corrected, 0), TABLES - 1))


@jit
def _update(context: Integers, base_table: int, magnitude: int) -> None:
    context[_FRAME_MAGNITUDES] += magnitude
    context[_FRAME_EXPECTED] += _MEANS[base_table]
    context[_LAST_BUT_ONE] = context[_LAST]
    context[_LAST] = 1 if magnitude > 0 else 0


@jit
def _list_values(
    values: Integers,
    tables: Integers,
    references: Integers,
    context: Integers,
    decisions: Integers,
) -> int:
    """Write the decisions (2, n), see `value_decisions`; their number."""
    count = 0
    for row in range(values.shape[0]):
        _start_frame(context)
        for k in range(values.shape[1]):
            table = _table(context, tables[row, k], references[row, k])
            count = _list_value(values[row, k], table, decisions, count)
            _update(context, tables[row, k], abs(values[row, k]))
    return count


@jit
def _list_value(value: int, table: int, decisions: Integers, count: int) -> int:
    """Write the decisions of a value from `count` on; the number then."""
    magnitude = abs(value)
    decisions[0, count], decisions[1, count] = 1 if magnitude else 0, _ZEROS[table]
    if not magnitude:
        return count + 1
    decisions[0, count + 1], decisions[1, count + 1] = 1 if value < 0 else 0, _EVEN
    count += 2
    for _ in range(1, min(magnitude, UNARY_LIMIT + 1)):
        decisions[0, count], decisions[1, count] = 1, _STOPS[table]
        count += 1
    if magnitude <= UNARY_LIMIT:
        decisions[0, count], decisions[1, count] = 0, _STOPS[table]
        return count + 1
    excess = magnitude - UNARY_LIMIT - 1
    count = list_exp_golomb(excess >> ESCAPE_LOW, decisions, count)
    for place in range(ESCAPE_LOW - 1, -1, -1):
        decisions[0, count], decisions[1, count] = excess >> place & 1, _EVEN
        count += 1
    return count
