"""The values of the tiles of a picture residual as decisions of a range coder, in compiled loops.

Encoder and decoder run the same loop: an encoder lists its decisions, a decoder reads them.  All
contexts adapt as those of `AdaptiveBits` do; they begin with the probabilities of
`initial_probabilities`.
"""

from collections.abc import Sequence
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import MIN_PROBABILITY
from protocol.entropy.compiled_decoding import Bytes, adapt, read_bit
from protocol.entropy.range_coder import PROBABILITY_ONE
from runtime.jit import jit
from shared_model.arrays import Integers, Picture

# Values of tiles, in quantiser steps.
TileValues = NDArray[np.int16]
# Sides of a tile of luma in small and in other pictures, samples; a colour difference has half.
SMALL_TILE, LARGE_TILE = 8, 16
# Bits that a context counts for at its start: it adapts no faster than after so many.
INITIAL_COUNT = 6
# Magnitudes above this have an escape code.
UNARY_LIMIT = 14
LONGEST_ESCAPE = 13

# Classes of planes (luma, colour), of temporal frequencies, of spatial frequencies (the binary
# length of row + column), and of the magnitudes nearby.
PLANES, TIMES, FREQUENCIES, NEARBY = 2, 4, 6, 10
# First context of each kind of decision.
FLAG = 0  # is a tile coded, by its neighbours to the left, above left, above, above right
FINE = FLAG + 16  # has it the finer step, by those to the left and above
PLANE = FINE + 4  # has it values in a plane, by the plane and the same of the tile to the left
BAND = PLANE + 3 * 3  # has it values at a temporal frequency, by the one before and its class
REACH = BAND + PLANES * TIMES * 2  # how far its spatial frequencies go
ZERO = REACH + PLANES * TIMES * FREQUENCIES  # is a value not 0
MORE = ZERO + PLANES * TIMES * FREQUENCIES * NEARBY  # is it more than 1, 2, 3 and above
CONTEXTS = MORE + PLANES * NEARBY * 3
# Registers of the loop: code, range and position of `RangeDecoder`, then decisions listed so far,
# and whether it lists decisions instead of reading them.
_COUNT, _LISTS = 3, 4
REGISTERS = 5
_EVEN = PROBABILITY_ONE // 2


# The odds of a zero before a context adapts, in half octaves: of FLAG, FINE, PLANE and BAND for
# each context, of the others the sum of these terms.
FLAG_ODDS = (11, 4, 5, 2, 0, -2, 0, -1, 2, -1, 2, -1, -1, -4, -4, -7)
FINE_ODDS = (8, -4, -4, -12)
PLANE_ODDS = (-12, -14, -16, 10, 1, -5, 11, 1, -6)
BAND_ODDS = (-10, 0, -8, 2, 12, 0, 14, -1, -8, 0, -4, 7, 14, 3, 16, 5)
REACH_ODDS = {"plane": (0, 8), "length": (-2, -2, 0, 3, 7, 7)}
ZERO_ODDS = {
    "plane": (0, -2),
    "time": (-1, 0, 0, 0),
    "frequency": (-6, 0, 1, 1, 1, 2),
    "nearby": (8, 2, 2, 0, 0, -1, -2, -3, -3, -4),
}
MORE_ODDS = {"nearby": (4, 2, 2, 0, -1, 0, -1, -1, -2, -2), "reached": (3, 1, -1)}


@cache
def initial_probabilities() -> Integers:
    """(CONTEXTS,) of a zero in each context, in 1 / 65536."""
    no_times = (0,) * TIMES
    odds = [
        *FLAG_ODDS,
        *FINE_ODDS,
        *PLANE_ODDS,
        *BAND_ODDS,
        *_sums(REACH_ODDS["plane"], no_times, REACH_ODDS["length"]),
        *_sums(*ZERO_ODDS.values()),
        *_sums((0,) * PLANES, *MORE_ODDS.values()),
    ]
    zeros = np.rint(PROBABILITY_ONE / (1 + 2.0 ** (-np.array(odds) / 2)))
    return np.clip(zeros, MIN_PROBABILITY, PROBABILITY_ONE - MIN_PROBABILITY).astype(np.int64)


def _sums(*terms: Sequence[int]) -> list[int]:
    """The sums of one of each, the last ones changing fastest."""
    return [sum(each) for each in product(*terms)]


def diagonal_order(side: int) -> Integers:
    """(side ** 2,) places of the values of a square, by diagonals, each from its top."""
    rows, columns = np.divmod(np.arange(side**2), side)
    return np.lexsort((rows, rows + columns)).astype(np.int64)


# The orders of all sides, one after the other.
_SIDES = LARGE_TILE, SMALL_TILE, SMALL_TILE // 2
ORDERS = np.concatenate([diagonal_order(side) for side in _SIDES])


def values_of_tile(side: int) -> int:
    """Values of a tile at one temporal frequency: luma, then two colour differences."""
    return side**2 + 2 * (side // 2) ** 2


@jit
def plane_start(plane: int, side: int) -> int:
    """Number of the first value of a plane.  side: of the tile."""
    return side**2 + (plane - 1) * (side // 2) ** 2 if plane else 0


@jit
def order_start(side: int) -> int:
    """Where the order of a side begins in `ORDERS`."""
    if side == LARGE_TILE:
        return 0
    return LARGE_TILE**2 if side == SMALL_TILE else LARGE_TILE**2 + SMALL_TILE**2


@jit
def side_of(values: int) -> int:
    """The side of a tile with so many values."""
    return SMALL_TILE if 2 * values == 3 * SMALL_TILE**2 else LARGE_TILE


@jit
def code_tiles(
    data: Bytes,
    registers: Integers,
    decisions: Integers,
    probabilities: Integers,
    flags: Picture,
    values: TileValues,
) -> bool:
    """Code the tiles of a grid; False if a value is too large.

    data, registers: of the range decoder, see above.
    decisions: (2, n) of an encoder, see `symbol_writing.Decisions`.
    probabilities: (CONTEXTS,) at the start; they are adapted.
    flags: (rows, columns) 0: no values, 1: values, 2: values of the finer step.
    values: (rows, columns, frames, `values_of_tile`), of tiles without values 0.
    A decoder writes flags and values, which are 0 before.
    """
    counts = np.full(CONTEXTS, INITIAL_COUNT)
    coder = data, registers, decisions, probabilities, counts
    planes = np.zeros((flags.shape[1], 3), np.int64)
    for row in range(flags.shape[0]):
        for column in range(flags.shape[1]):
            _code_flags(coder, flags, row, column)
            if not flags[row, column]:
                planes[column] = 0
                continue
            for plane in range(3):
                before = planes[column - 1, plane] if column else 0
                above = planes[column, plane]
                if not _code_plane(coder, values, row, column, plane, before + above, planes):
                    return False
    return True


@jit
def _bit(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers], context: int, bit: int
) -> int:
    """Code a bit in a context, which adapts."""
    _, _, _, probabilities, counts = coder
    bit = _decide(coder, probabilities[context], bit)
    adapt(probabilities, counts, context, bit)
    return bit


@jit
def _even_bit(coder: tuple[Bytes, Integers, Integers, Integers, Integers], bit: int) -> int:
    """Code a bit that is as likely 0 as 1."""
    return _decide(coder, _EVEN, bit)


@jit
def _decide(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers], zero: int, bit: int
) -> int:
    """List a bit that is 0 with probability `zero` / 65536, or read it."""
    data, registers, decisions, _, _ = coder
    if not registers[_LISTS]:
        return read_bit(data, registers, zero)
    decisions[0, registers[_COUNT]], decisions[1, registers[_COUNT]] = bit, zero
    registers[_COUNT] += 1
    return bit


@jit
def _code_flags(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers],
    flags: Picture,
    row: int,
    column: int,
) -> None:
    left = flags[row, column - 1] if column else 0
    above = flags[row - 1, column] if row else 0
    above_left = flags[row - 1, column - 1] if row and column else 0
    above_right = flags[row - 1, column + 1] if row and column + 1 < flags.shape[1] else 0
    context = 8 * (left > 0) + 4 * (above > 0) + 2 * (above_left > 0) + (above_right > 0)
    flag = flags[row, column]
    if not _bit(coder, FLAG + context, 1 if flag else 0):
        flags[row, column] = 0
        return
    fine = _bit(coder, FINE + 2 * (left == 2) + (above == 2), 1 if flag == 2 else 0)
    flags[row, column] = 1 + fine


@jit
def _code_plane(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers],
    values: TileValues,
    row: int,
    column: int,
    plane: int,
    around: int,
    planes: Integers,
) -> bool:
    """Code one plane of a tile.  around: number of neighbours that have values in it."""
    tile = side_of(values.shape[3])
    start = plane_start(plane, tile)
    kind, side = (1, tile // 2) if plane else (0, tile)
    own = values[row, column]
    has_values = 0
    if coder[1][_LISTS]:
        has_values = 1 if np.any(own[:, start : start + side**2]) else 0
    has_values = _bit(coder, PLANE + 3 * plane + around, has_values)
    planes[column, plane] = has_values
    if not has_values:
        return True
    before = 0
    for time in range(own.shape[0]):
        time_class = class_of_time(time)
        reach = -1
        if coder[1][_LISTS]:
            for place in range(side**2):
                if own[time, start + place]:
                    reach = max(reach, place // side + place % side)
        context = BAND + 2 * (TIMES * kind + time_class) + before
        before = _bit(coder, context, 1 if reach >= 0 else 0)
        if not before:
            continue
        reach = _code_reach(coder, REACH + FREQUENCIES * (TIMES * kind + time_class), reach)
        if reach > 2 * (side - 1):
            return False
        if not _code_band(coder, values, row, column, time, kind, start, side, reach):
            return False
    return True


@jit
def class_of_time(time: int) -> int:
    """The class of a temporal frequency."""
    return time if time < 2 else 2 if time < 4 else 3


@jit
def length_of(number: int) -> int:
    """The binary length of a number; 0 of one below 1."""
    length = 0
    while number > 0:
        number, length = number >> 1, length + 1
    return length


@jit
def _code_reach(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers], first: int, reach: int
) -> int:
    """Code the last diagonal with a value: its binary length, then the digits after the first."""
    wanted, length = length_of(reach), 0
    while length < FREQUENCIES - 1 and _bit(coder, first + length, 1 if wanted > length else 0):
        length += 1
    if not length:
        return 0
    number = 1
    for place in range(length - 2, -1, -1):
        number = 2 * number + _even_bit(coder, reach >> place & 1)
    return number


@jit
def magnitudes_nearby(
    values: TileValues, row: int, column: int, time: int, start: int, side: int, place: int
) -> int:
    """The class of the magnitudes that are known near a value."""
    u, v = place // side, place % side
    own, at = values[row, column], start + place
    total = 0
    if u:
        total += 2 * min(abs(own[time, at - side]), 2)
    if v:
        total += 2 * min(abs(own[time, at - 1]), 2)
    if time:
        total += 2 * min(abs(own[time - 1, at]), 2)
    if row:
        total += min(abs(values[row - 1, column, time, at]), 2)
    if column:
        total += min(abs(values[row, column - 1, time, at]), 2)
    return min(total, NEARBY - 1)


@jit
def zero_context(kind: int, time: int, diagonal: int, nearby: int) -> int:
    """The context of the decision whether a value is not 0.  diagonal: its row + column."""
    frequency = min(length_of(diagonal), FREQUENCIES - 1)
    return ZERO + NEARBY * (FREQUENCIES * (TIMES * kind + class_of_time(time)) + frequency) + nearby


@jit
def _code_band(
    coder: tuple[Bytes, Integers, Integers, Integers, Integers],
    values: TileValues,
    row: int,
    column: int,
    time: int,
    kind: int,
    start: int,
    side: int,
    reach: int,
) -> bool:
    """Code the values of a tile at one temporal frequency, up to diagonal `reach`."""
    first = order_start(side)
    own = values[row, column, time]
    for index in range(side**2):
        place = ORDERS[first + index]
        diagonal = place // side + place % side
        if diagonal > reach:
            break
        value = own[start + place]
        nearby = magnitudes_nearby(values, row, column, time, start, side, place)
        if not _bit(coder, zero_context(kind, time, diagonal, nearby), 1 if value else 0):
            continue
        magnitude, wanted = 1, abs(value)
        more = MORE + 3 * (NEARBY * kind + nearby)
        while magnitude < UNARY_LIMIT and _bit(
            coder, more + min(magnitude, 3) - 1, 1 if wanted > magnitude else 0
        ):
            magnitude += 1
        if magnitude == UNARY_LIMIT:
            excess = _code_escape(coder, wanted - UNARY_LIMIT)
            if excess < 0:
                return False
            magnitude += excess
        own[start + place] = -magnitude if _even_bit(coder, 1 if value < 0 else 0) else magnitude
    return True


@jit
def _code_escape(coder: tuple[Bytes, Integers, Integers, Integers, Integers], excess: int) -> int:
    """Code a number >= 0 as `code_exp_golomb` does; -1 if it is too large."""
    digits = length_of(excess + 1) - 1
    length = 0
    while _even_bit(coder, 1 if digits > length else 0):
        length += 1
        if length > LONGEST_ESCAPE:
            return -1
    number = 1
    for place in range(length - 1, -1, -1):
        number = 2 * number + _even_bit(coder, (excess + 1) >> place & 1)
    return number - 1
