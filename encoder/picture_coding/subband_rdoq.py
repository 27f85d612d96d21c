"""Rate-distortion optimised quantisation of one subband, in compiled loops.

Each coefficient becomes the nearest integer, the integer below it in magnitude, or zero: the one
with the least squared error, in quantiser steps, plus `LAGRANGIAN` times bits, under the
probabilities that will code it.  A tile without a coefficient above `TILE_THRESHOLD` is coded as
empty.

Throughout, p0 is the probability that a binary symbol is 0, in 1/65536.
"""

from typing import NamedTuple

import numpy as np

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.pictures.coefficient_coding import MAX_MAGNITUDE, STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.coefficient_context import (
    PAD,
    SMALL_BAND,
    TILE,
    context_offsets,
    tile_grid,
)
from protocol.pictures.probability_model import BandPosition, probability_models
from protocol.pictures.subband_pyramid import RECONSTRUCTION_BIAS
from protocol.pictures.symbol_prediction import (
    PASSES,
    Predictor,
    add_to_context,
    context_grids,
    list_positions,
    make_predictor,
    predict,
)
from runtime.jit import jit
from shared_model.arrays import Array, Integers, Mask

# Squared quantiser steps per bit.
LAGRANGIAN = 0.15
# A tile is coded if a coefficient in it exceeds this many quantiser steps.
TILE_THRESHOLD = 0.85
# Assumed cost of a sign while its magnitude is chosen, bits.
SIGN_BITS = 0.9
# Cost in bits of a 0, by its p0.
ZERO_BITS = -np.log2(np.maximum(np.arange(PROBABILITY_ONE), 0.5) / PROBABILITY_ONE)


class QuantisedBand(NamedTuple):
    """A quantised subband and its symbols in coding order.

    values: (h, w) the integers.
    flags: (f,) of tiles, pass by pass.  flag_p0: (f,).
    magnitudes: (n,).  magnitude_p0: (n, outputs), see `probability_model.ProbabilityModels`.
    signs: (s,) of the magnitudes that are not zero, 1 where negative.  sign_p0: (s,).
    pass_ends: (passes, 2) number of magnitudes and of signs up to the end of each pass.
    bits: ideal code length of all symbols.
    """

    values: Integers
    flags: Integers
    flag_p0: Integers
    magnitudes: Integers
    magnitude_p0: Integers
    signs: Integers
    sign_p0: Integers
    pass_ends: Integers
    bits: float


def quantise_subband(
    position: BandPosition, coefficients: Array, context_bands: Integers
) -> QuantisedBand:
    """Quantise the coefficients (h, w) of a subband, in quantiser steps.

    context_bands: (len(ContextBand), h, w), see `coefficient_context.ContextBand`.
    """
    height, width = coefficients.shape
    tile_context, _ = context_offsets(*tile_grid(coefficients.shape))
    magnitude_context, sign_context = context_offsets(height, width)
    models = probability_models()
    fields = position.kind, position.plane, position.level, position.orientation, position.pictures
    return QuantisedBand(
        *_quantise(
            np.ascontiguousarray(coefficients),
            context_bands,
            np.array(fields),
            RECONSTRUCTION_BIAS if position.level else 0.0,
            make_predictor(models.tiles, tile_context),
            make_predictor(models.sizes, magnitude_context),
            make_predictor(models.signs, sign_context),
            ZERO_BITS,
        )
    )


@jit
def _quantise(
    coefficients: Array,
    context_bands: Integers,
    band: Integers,
    bias: float,
    of_flags: Predictor,
    of_magnitudes: Predictor,
    of_signs: Predictor,
    zero_bits: Array,
) -> tuple[Integers, Integers, Integers, Integers, Integers, Integers, Integers, Integers, float]:
    """The fields of `QuantisedBand`.

    band: (5,) the fields of `BandPosition`.  bias, zero_bits: see `_choose_magnitudes`.
    """
    shape = coefficients.shape
    flags, coded_flags, flag_p0, bits = _quantise_flags(
        coefficients, context_bands, band, of_flags, zero_bits
    )
    active, active_around = _expand_flags(flags, shape)
    magnitude_grids, value_grids = context_grids(context_bands, active_around)
    rows, columns, starts = list_positions(active)
    values, count, signed = np.zeros(shape, np.int64), len(rows), 0
    magnitudes, signs = np.zeros(count, np.int64), np.zeros(count, np.int64)
    magnitude_p0 = np.zeros((count, len(of_magnitudes.output_bias)), np.int64)
    sign_p0 = np.zeros((count, 1), np.int64)
    pass_ends = np.zeros((PASSES, 2), np.int64)
    for number in range(PASSES):
        here = slice(starts[number], starts[number + 1])
        places = rows[here], columns[here]
        predict(of_magnitudes, band, number, magnitude_grids, shape, *places, magnitude_p0[here])
        bits += _choose_magnitudes(
            coefficients, *places, magnitude_p0[here], bias, zero_bits, magnitudes[here]
        )
        nonzero = np.nonzero(magnitudes[here])[0] + starts[number]
        places = rows[nonzero], columns[nonzero]
        p0 = sign_p0[signed : signed + len(nonzero)]
        predict(of_signs, band, number, value_grids, shape, *places, p0)
        bits = _code_signs(
            coefficients, *places, magnitudes[nonzero], p0, zero_bits, values, signs[signed:], bits
        )
        add_to_context(*places, values, magnitude_grids, value_grids)
        signed += len(nonzero)
        pass_ends[number, 0], pass_ends[number, 1] = starts[number + 1], signed
    return (
        values, coded_flags, flag_p0, magnitudes, magnitude_p0, signs[:signed],
        sign_p0[:signed, 0].copy(), pass_ends, bits,
    )  # fmt: skip


@jit
def _code_signs(
    coefficients: Array,
    rows: Integers,
    columns: Integers,
    magnitudes: Integers,
    p0: Integers,
    zero_bits: Array,
    values: Integers,
    signs: Integers,
    bits: float,
) -> float:
    """Write the signs (n,) at positions (n,) and the signed values; returns `bits` plus theirs."""
    for k in range(len(rows)):
        row, column, zero = rows[k], columns[k], p0[k, 0]
        negative = coefficients[row, column] < 0
        signs[k] = negative
        bits += zero_bits[PROBABILITY_ONE - zero if negative else zero]
        values[row, column] = -magnitudes[k] if negative else magnitudes[k]
    return bits


@jit
def _quantise_flags(
    coefficients: Array,
    context_bands: Integers,
    band: Integers,
    predictor: Predictor,
    zero_bits: Array,
) -> tuple[Integers, Integers, Integers, float]:
    """Flags (tile rows, tile columns) of the tiles to code; the flags (f,) in coding order with
    their p0 (f,); and their bits."""
    shape = -(-coefficients.shape[0] // TILE), -(-coefficients.shape[1] // TILE)
    count = shape[0] * shape[1]
    if count * TILE**2 <= SMALL_BAND:
        none = np.zeros(0, np.int64)
        return np.ones(shape, np.int64), none, none, 0.0
    flags, grids = _flags_and_grids(coefficients, context_bands, shape)
    coded, p0, bits = np.zeros(count, np.int64), np.zeros((count, 1), np.int64), 0.0
    rows, columns, starts = list_positions(np.ones(shape, np.bool_))
    for number in range(PASSES):
        here = slice(starts[number], starts[number + 1])
        predict(predictor, band, number, grids, shape, rows[here], columns[here], p0[here])
        for k in range(starts[number], starts[number + 1]):
            row, column = rows[k], columns[k]
            coded[k] = flags[row, column]
            bits += zero_bits[PROBABILITY_ONE - p0[k, 0] if coded[k] else p0[k, 0]]
            grids[(row + PAD) * (shape[1] + 2 * PAD) + column + PAD] = coded[k]
    return flags, coded, p0[:, 0].copy(), bits


@jit
def _flags_and_grids(
    coefficients: Array, context_bands: Integers, shape: tuple[int, int]
) -> tuple[Integers, Integers]:
    """Flags of the tiles to code, in `shape`, and the padded grids, flat, that they are predicted
    from: sums of the context bands' magnitudes over each tile."""
    height, width = shape
    flags = np.zeros((height, width), np.int64)
    grids = np.zeros((len(context_bands) + 2, height + 2 * PAD, width + 2 * PAD), np.int64)
    for row in range(coefficients.shape[0]):
        for column in range(coefficients.shape[1]):
            tile = row // TILE, column // TILE
            if abs(coefficients[row, column]) > TILE_THRESHOLD:
                flags[tile] = 1
            for band in range(len(context_bands)):
                magnitude = abs(context_bands[band, row, column])
                grids[1 + band, PAD + tile[0], PAD + tile[1]] += magnitude
    return flags, grids.ravel()


@jit
def _expand_flags(flags: Integers, shape: tuple[int, int]) -> tuple[Mask, Integers]:
    """For each coefficient, in `shape`: the flag of its tile, and the number of flags in the 3 x 3
    tiles around."""
    height, width = shape
    active = np.zeros((height, width), np.bool_)
    around = np.zeros((height, width), np.int64)
    for row in range(height):
        for column in range(width):
            i, j = row // TILE, column // TILE
            active[row, column] = flags[i, j] > 0
            around[row, column] = flags[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].sum()
    return active, around


@jit
def _choose_magnitudes(
    coefficients: Array,
    rows: Integers,
    columns: Integers,
    p0: Integers,
    bias: float,
    zero_bits: Array,
    magnitudes: Integers,
) -> float:
    """Write the magnitudes (n,) of least cost at positions (n,); returns their bits without signs.

    p0: (n, outputs), see `probability_model.ProbabilityModels`.  zero_bits: see `ZERO_BITS`.
    bias: by how much a decoded magnitude lies below its integer, quantiser steps.
    """
    total = 0.0
    for k in range(len(rows)):
        target = abs(coefficients[rows[k], columns[k]])
        nearest = min(int(target + 0.5), MAX_MAGNITUDE) if target > 0.5 else 0
        bits = zero_bits[p0[k, 0]]
        least = target**2 + LAGRANGIAN * bits
        for magnitude in range(max(nearest - 1, 1), nearest + 1):
            magnitude_bits = _magnitude_bits(magnitude, p0[k], zero_bits)
            error = target - magnitude + bias
            cost = error * error + LAGRANGIAN * (magnitude_bits + SIGN_BITS)
            if cost < least:
                magnitudes[k], least, bits = magnitude, cost, magnitude_bits
        total += bits
    return total


@jit
def _magnitude_bits(magnitude: int, p0: Integers, zero_bits: Array) -> float:
    """Bits of one magnitude without its sign; p0: (outputs,)."""
    bits = 0.0
    for step in range(min(magnitude, UNARY_LIMIT)):
        bits += zero_bits[PROBABILITY_ONE - p0[STEP_OUTPUTS[step]]]
    if magnitude < UNARY_LIMIT:
        return float(bits + zero_bits[p0[STEP_OUTPUTS[magnitude]]])
    length = int(np.log2(magnitude - UNARY_LIMIT + 1))
    return float(bits + 2 * length + 1)
