"""Rate-distortion optimised quantisation of the tiles of a picture residual, in compiled loops.

Each value becomes the nearest integer, the one below it in magnitude or zero: the one with the
least squared error plus `LAGRANGIAN` times bits, in steps.  Values at one temporal frequency, and
whole tiles, are left out where they cost more than they gain.  Bits are those of the contexts
before they adapt.
"""

from typing import NamedTuple

import numpy as np

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.picture_residual.residual_block import BIAS
from protocol.picture_residual.tile_coding import (
    BAND,
    FLAG,
    FREQUENCIES,
    MORE,
    NEARBY,
    ORDERS,
    PLANE,
    REACH,
    TIMES,
    UNARY_LIMIT,
    TileValues,
    class_of_time,
    initial_probabilities,
    length_of,
    magnitudes_nearby,
    order_start,
    plane_start,
    side_of,
    zero_context,
)
from runtime.jit import jit
from shared_model.arrays import Array, Integers, Mask, Picture, Single

# Squared steps that a bit must gain in the face; around it `around_price` times as many.
LAGRANGIAN = 0.1
# A value below this is zero whatever its context, steps.
ZERO_BELOW = 0.55
# Bits by the probability of what happens.
BITS = -np.log2(np.maximum(np.arange(PROBABILITY_ONE + 1), 0.5) / PROBABILITY_ONE)


class QuantisedTiles(NamedTuple):
    """flags, values: see `tile_coding.code_tiles`."""

    flags: Picture
    values: TileValues


def quantise_tiles(
    values: Single, step: float, is_fine: Mask, around_price: float = 1.0
) -> QuantisedTiles:
    """Quantise the values (rows, columns, frames, `values_of_tile`) of a group.

    is_fine: (rows, columns) tiles with half the step.
    around_price: how much more bits of other tiles cost.
    """
    flags = np.zeros(values.shape[:2], np.uint8)
    coded = np.zeros(values.shape, np.int16)
    _quantise(values, step, is_fine, around_price, initial_probabilities(), BITS, flags, coded)
    return QuantisedTiles(flags, coded)


@jit
def _quantise(
    values: Single,
    step: float,
    is_fine: Mask,
    around_price: float,
    p0: Integers,
    bits_of: Array,
    flags: Picture,
    coded: TileValues,
) -> None:
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            own_step = step / 2 if is_fine[row, column] else step
            lagrangian = LAGRANGIAN if is_fine[row, column] else around_price * LAGRANGIAN
            around = (row > 0 and flags[row - 1, column] > 0) + (
                column > 0 and flags[row, column - 1] > 0
            )
            flag = FLAG + (15 if around == 2 else 8 if around else 0)
            saved = -lagrangian * (bits_of[PROBABILITY_ONE - p0[flag]] - bits_of[p0[flag]])
            for plane in range(3):
                saved += _quantise_plane(
                    values[row, column],
                    own_step,
                    lagrangian,
                    row,
                    column,
                    plane,
                    p0,
                    bits_of,
                    coded,
                )
            if saved > 0 and np.any(coded[row, column]):
                flags[row, column] = 2 if is_fine[row, column] else 1
            else:
                coded[row, column] = 0


@jit
def _quantise_plane(
    values: Single,
    step: float,
    lagrangian: float,
    row: int,
    column: int,
    plane: int,
    p0: Integers,
    bits_of: Array,
    coded: TileValues,
) -> float:
    """Quantise a plane of a tile; by how much cost has fallen, squared steps."""
    tile = side_of(values.shape[1])
    kind, side = (1, tile // 2) if plane else (0, tile)
    start, saved, before = plane_start(plane, tile), 0.0, 0
    for time in range(values.shape[0]):
        reach = -1
        for place in range(side**2):
            if abs(values[time, start + place]) > ZERO_BELOW * step:
                reach = max(reach, place // side + place % side)
        context = BAND + 2 * (TIMES * kind + class_of_time(time)) + before
        before = 0
        if reach < 0:
            continue
        gain = _quantise_band(
            values[time],
            step,
            lagrangian,
            row,
            column,
            time,
            start,
            kind,
            side,
            reach,
            p0,
            bits_of,
            coded,
        )
        gain -= lagrangian * (bits_of[PROBABILITY_ONE - p0[context]] - bits_of[p0[context]])
        if gain > 0:
            saved += gain
            before = 1
        else:
            coded[row, column, time, start : start + side**2] = 0
    context = PLANE + 3 * plane
    saved -= lagrangian * (bits_of[PROBABILITY_ONE - p0[context]] - bits_of[p0[context]])
    if saved <= 0:
        coded[row, column, :, start : start + side**2] = 0
        return 0.0
    return float(saved)


@jit
def _quantise_band(
    values: Single,
    step: float,
    lagrangian: float,
    row: int,
    column: int,
    time: int,
    start: int,
    kind: int,
    side: int,
    reach: int,
    p0: Integers,
    bits_of: Array,
    coded: TileValues,
) -> float:
    """Quantise a plane of a tile at one temporal frequency; by how much cost has fallen."""
    first = order_start(side)
    classes = TIMES * kind + class_of_time(time)
    saved, best, best_index = 0.0, 0.0, -1
    own = coded[row, column, time]
    for index in range(side**2):
        place = ORDERS[first + index]
        diagonal = place // side + place % side
        if diagonal > reach:
            break
        nearby = magnitudes_nearby(coded, row, column, time, start, side, place)
        context = zero_context(kind, time, diagonal, nearby)
        size = abs(values[start + place]) / step
        nearest = min(int(size + 0.5), 16000)
        cost, chosen = size * size + lagrangian * bits_of[p0[context]], 0
        if size > ZERO_BELOW:
            more = MORE + 3 * (NEARBY * kind + nearby)
            for magnitude in range(max(nearest - 1, 1), nearest + 1):
                error = size - magnitude + BIAS
                bits = bits_of[PROBABILITY_ONE - p0[context]] + 1
                bits += _bits_of_magnitude(magnitude, more, p0, bits_of)
                if error * error + lagrangian * bits < cost:
                    cost, chosen = error * error + lagrangian * bits, magnitude
        own[start + place] = -chosen if values[start + place] < 0 else chosen
        saved += size * size - cost
        if chosen and saved > best:
            best, best_index = saved, index
    for index in range(best_index + 1, side**2):
        own[start + ORDERS[first + index]] = 0
    if best_index < 0:
        return 0.0
    last = ORDERS[first + best_index]
    return best - lagrangian * _bits_of_reach(
        last // side + last % side, REACH + FREQUENCIES * classes, p0, bits_of
    )


@jit
def _bits_of_magnitude(magnitude: int, more: int, p0: Integers, bits_of: Array) -> float:
    """Bits of a magnitude of 1 or more, given that it is not 0."""
    bits = 0.0
    for reached in range(1, min(magnitude, UNARY_LIMIT)):
        bits += bits_of[PROBABILITY_ONE - p0[more + min(reached, 3) - 1]]
    if magnitude < UNARY_LIMIT:
        return float(bits + bits_of[p0[more + min(magnitude, 3) - 1]])
    return float(bits + 2 * length_of(magnitude - UNARY_LIMIT + 1) - 1)


@jit
def _bits_of_reach(reach: int, first: int, p0: Integers, bits_of: Array) -> float:
    wanted, bits = length_of(reach), 0.0
    for length in range(wanted):
        bits += bits_of[PROBABILITY_ONE - p0[first + length]]
    if wanted < FREQUENCIES - 1:
        bits += bits_of[p0[first + wanted]]
    return float(bits + max(wanted - 1, 0))
