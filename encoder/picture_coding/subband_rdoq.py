"""Rate-distortion optimised quantisation of one subband, in compiled loops.

Each coefficient becomes the nearest integer, the integer below it in magnitude, or zero: the one
with the least squared error, in quantiser steps, plus `LAGRANGIAN` times bits, under the
probabilities that will code it.  A tile without a coefficient above `TILE_THRESHOLD` is coded as
empty.

The loops repeat the coding order and the context model of `protocol.pictures.subband_coding`,
`coefficient_context` and `probability_model`, which work on whole arrays.  All sums are exact
integers; tests/test_subband_coding.py checks that both give the same probabilities.

Throughout, p0 is the probability that a binary symbol is 0, in 1/65536.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import jit
from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.pictures.coefficient_coding import MAX_MAGNITUDE, STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.coefficient_context import (
    FIRST_SIGNED,
    LOG_TABLE,
    PAD,
    PASS_OFFSETS,
    POSITION_CELLS,
    SMALL_BAND,
    TILE,
    ContextOffsets,
    context_offsets,
)
from protocol.pictures.probability_model import (
    CLASS_STARTS,
    HIDDEN_BITS,
    MAX_HIDDEN,
    MAX_LOGIT,
    SIGMOID,
    WEIGHT_BITS,
    BandPosition,
    Mlp,
    probability_models,
)
from protocol.pictures.subband_coding import RECONSTRUCTION_BIAS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

# Squared quantiser steps per bit.
LAGRANGIAN = 0.12
# A tile is coded if a coefficient in it exceeds this many quantiser steps.
TILE_THRESHOLD = 0.85
# Assumed cost of a sign while its magnitude is chosen, bits.
SIGN_BITS = 0.9
# Cost in bits of a 0, by its p0.
ZERO_BITS = -np.log2(np.maximum(np.arange(PROBABILITY_ONE), 0.5) / PROBABILITY_ONE)
_PASS_OFFSETS = np.array(PASS_OFFSETS)
_STARTS = np.array(CLASS_STARTS)


class QuantisedBand(NamedTuple):
    """A quantised subband and its symbols in coding order.

    values: (h, w) the integers.
    flags: (f,) of tiles, pass by pass.  flag_p0: (f,).
    magnitudes: (n,).  magnitude_p0: (n, outputs), see `probability_model.Networks`.
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


class _Mlp(NamedTuple):
    """The weights of a `probability_model.Network`, see there."""

    features: Array
    of_pass: Array
    classes: Array
    output: Array
    bias: Array


class _ContextOffsets(NamedTuple):
    """The arrays of `coefficient_context.Sums`, see there."""

    offsets: Integers
    sides: Integers
    starts: Integers


class _Tables(NamedTuple):
    """`coefficient_context.LOGARITHM`, `probability_model.SQUASHED` and `ZERO_BITS`."""

    logarithm: Array
    sigmoid: Integers
    zero_bits: Array


_TABLES = _Tables(LOG_TABLE, SIGMOID, ZERO_BITS)


def quantise_subband(
    site: BandPosition, coefficients: Array, context_bands: Integers
) -> QuantisedBand:
    """Quantise the coefficients (h, w) of a subband, in quantiser steps.

    context_bands: (len(Source), h, w), see `coefficient_context.Source`.
    """
    height, width = coefficients.shape
    tile_offsets, _ = context_offsets(-(-height // TILE), -(-width // TILE))
    magnitude_offsets, sign_offsets = context_offsets(height, width)
    models = probability_models()
    return QuantisedBand(
        *_quantise(
            np.ascontiguousarray(coefficients),
            context_bands,
            np.array([site.kind, site.plane, site.level, site.orientation, site.pictures]),
            RECONSTRUCTION_BIAS if site.level else 0.0,
            (_mlp(models.tiles), _mlp(models.sizes), _mlp(models.signs)),
            (_offsets(tile_offsets), _offsets(magnitude_offsets), _offsets(sign_offsets)),
            _TABLES,
        )
    )


def _mlp(network: Mlp) -> _Mlp:
    return _Mlp(
        network.feature_weights,
        network.pass_weights,
        network.class_weights,
        network.output_weights,
        network.output_bias,
    )


def _offsets(sums: ContextOffsets) -> _ContextOffsets:
    return _ContextOffsets(sums.offsets, sums.mirrored, sums.starts)


@jit
def _quantise(
    coefficients: Array,
    context_bands: Integers,
    site: Integers,
    bias: float,
    mlps: tuple[_Mlp, _Mlp, _Mlp],
    offsets: tuple[_ContextOffsets, _ContextOffsets, _ContextOffsets],
    tables: _Tables,
) -> tuple[Integers, Integers, Integers, Integers, Integers, Integers, Integers, Integers, float]:
    """The fields of `QuantisedBand`.

    site: (5,) the fields of `Site`.  bias: see `_choose_magnitudes`.
    mlps, offsets: of tile flags, of magnitudes and of signs.
    """
    height, width = coefficients.shape
    flags, coded_flags, flag_p0, total = _quantise_flags(
        coefficients, context_bands, site, mlps[0], offsets[0], tables
    )
    active, active_around = _expand_flags(flags, height, width)
    magnitude_grids, value_grids = _context_grids(context_bands, active_around)
    values = np.zeros((height, width), np.int64)
    count, outputs = active.sum(), len(mlps[1].bias)
    magnitudes, magnitude_p0 = np.zeros(count, np.int64), np.zeros((count, outputs), np.int64)
    signs, sign_p0 = np.zeros(count, np.int64), np.zeros(count, np.int64)
    rows, columns = np.zeros(count, np.int64), np.zeros(count, np.int64)
    pass_ends = np.zeros((len(_PASS_OFFSETS), 2), np.int64)
    first, signed = 0, 0
    for number in range(len(_PASS_OFFSETS)):
        end = _list_positions(active, number, rows, columns, first)
        shared = _shared_activation(mlps[1], site, number, height)
        _predict_probabilities(
            mlps[1], shared, offsets[1], magnitude_grids, rows[first:end], columns[first:end],
            height, width, tables, magnitude_p0[first:end],
        )  # fmt: skip
        total += _choose_magnitudes(
            coefficients, rows[first:end], columns[first:end], magnitude_p0[first:end], bias,
            tables.zero_bits, magnitudes[first:end],
        )  # fmt: skip
        nonzero = np.nonzero(magnitudes[first:end])[0] + first
        p0 = np.zeros((len(nonzero), 1), np.int64)
        shared = _shared_activation(mlps[2], site, number, height)
        _predict_probabilities(
            mlps[2], shared, offsets[2], value_grids, rows[nonzero], columns[nonzero],
            height, width, tables, p0,
        )  # fmt: skip
        for k in range(len(nonzero)):
            index = nonzero[k]
            row, column = rows[index], columns[index]
            negative = coefficients[row, column] < 0
            signs[signed + k], sign_p0[signed + k] = negative, p0[k, 0]
            total += tables.zero_bits[PROBABILITY_ONE - p0[k, 0] if negative else p0[k, 0]]
            value = -magnitudes[index] if negative else magnitudes[index]
            values[row, column] = value
        # The values of a pass become context for later passes only.
        for index in nonzero:
            padded = (rows[index] + PAD) * (width + 2 * PAD) + columns[index] + PAD
            magnitude_grids[padded] = magnitudes[index]
            value_grids[padded] = values[rows[index], columns[index]]
        first, signed = end, signed + len(nonzero)
        pass_ends[number, 0], pass_ends[number, 1] = first, signed
    return (
        values, coded_flags, flag_p0, magnitudes, magnitude_p0, signs[:signed], sign_p0[:signed],
        pass_ends, total,
    )  # fmt: skip


@jit
def _context_grids(context_bands: Integers, active_around: Integers) -> tuple[Integers, Integers]:
    """Padded grids, flat, that magnitudes and signs are predicted from; grid 0, the band itself, is
    zero at first."""
    _, height, width = context_bands.shape
    magnitudes = np.zeros((len(context_bands) + 2, height + 2 * PAD, width + 2 * PAD), np.int64)
    magnitudes[1:-1, PAD:-PAD, PAD:-PAD] = np.abs(context_bands)
    magnitudes[-1, PAD:-PAD, PAD:-PAD] = active_around
    values = np.zeros(
        (1 + len(context_bands) - FIRST_SIGNED, height + 2 * PAD, width + 2 * PAD), np.int64
    )
    values[1:, PAD:-PAD, PAD:-PAD] = context_bands[FIRST_SIGNED:]
    return magnitudes.ravel(), values.ravel()


@jit
def _quantise_flags(
    coefficients: Array,
    context_bands: Integers,
    site: Integers,
    mlp: _Mlp,
    offsets: _ContextOffsets,
    tables: _Tables,
) -> tuple[Integers, Integers, Integers, float]:
    """Flags (tile rows, tile columns) of the tiles to code; the flags (f,) in coding order with
    their p0 (f,); and their bits."""
    height, width = -(-coefficients.shape[0] // TILE), -(-coefficients.shape[1] // TILE)
    if height * width * TILE**2 <= SMALL_BAND:
        none = np.zeros(0, np.int64)
        return np.ones((height, width), np.int64), none, none, 0.0
    flags, grids = _flags_and_grids(coefficients, context_bands, height, width)
    coded, p0 = np.zeros(height * width, np.int64), np.zeros((height * width, 1), np.int64)
    rows, columns = np.zeros(height * width, np.int64), np.zeros(height * width, np.int64)
    every = np.ones((height, width), np.bool_)
    first, total = 0, 0.0
    for number in range(len(_PASS_OFFSETS)):
        end = _list_positions(every, number, rows, columns, first)
        shared = _shared_activation(mlp, site, number, height)
        _predict_probabilities(
            mlp, shared, offsets, grids, rows[first:end], columns[first:end],
            height, width, tables, p0[first:end],
        )  # fmt: skip
        for k in range(first, end):
            row, column = rows[k], columns[k]
            coded[k] = flags[row, column]
            total += tables.zero_bits[PROBABILITY_ONE - p0[k, 0] if coded[k] else p0[k, 0]]
            grids[(row + PAD) * (width + 2 * PAD) + column + PAD] = coded[k]
        first = end
    return flags, coded, p0[:, 0].copy(), total


@jit
def _flags_and_grids(
    coefficients: Array, context_bands: Integers, height: int, width: int
) -> tuple[Integers, Integers]:
    """Flags (height, width) of the tiles to code, and the padded grids, flat, that they are
    predicted from: sums of the context bands' magnitudes over each tile."""
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
def _expand_flags(flags: Integers, height: int, width: int) -> tuple[Bools, Integers]:
    """For each coefficient (height, width): the flag of its tile, and the number of flags in the
    3 x 3 tiles around."""
    active = np.zeros((height, width), np.bool_)
    around = np.zeros((height, width), np.int64)
    for row in range(height):
        for column in range(width):
            i, j = row // TILE, column // TILE
            active[row, column] = flags[i, j] > 0
            around[row, column] = flags[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].sum()
    return active, around


@jit
def _list_positions(
    active: Bools, number: int, rows: Integers, columns: Integers, first: int
) -> int:
    """Write the active positions of a pass to `rows` and `columns` from index `first` on; returns
    the index after the last."""
    for row in range(_PASS_OFFSETS[number, 0], active.shape[0], 2):
        for column in range(_PASS_OFFSETS[number, 1], active.shape[1], 2):
            if active[row, column]:
                rows[first], columns[first] = row, column
                first += 1
    return first


@jit
def _shared_activation(mlp: _Mlp, site: Integers, number: int, height: int) -> Array:
    """(hidden,) the part of the hidden activations that all positions of a pass share."""
    classes, last = mlp.classes, len(LOG_TABLE) - 1
    shared: Array = LOG_TABLE[min(site[4], last)] * mlp.of_pass[0]
    shared += LOG_TABLE[min(height, last)] * mlp.of_pass[1]
    for kind in range(4):
        shared += classes[_STARTS[kind] + site[kind]]
    shared += classes[_STARTS[4] + number]
    return shared


@jit
def _predict_probabilities(
    mlp: _Mlp,
    shared: Array,
    offsets: _ContextOffsets,
    grids: Integers,
    rows: Integers,
    columns: Integers,
    height: int,
    width: int,
    tables: _Tables,
    p0: Integers,
) -> None:
    """Write the probabilities (n, outputs) of the symbols at positions (n,) to `p0`."""
    hidden, logits = np.empty(len(shared)), np.empty(len(mlp.bias))
    starts, logarithm = offsets.starts, tables.logarithm
    for k in range(len(rows)):
        row, column = rows[k], columns[k]
        row_start = (row + PAD) * (width + 2 * PAD) + PAD
        # The position itself, and its mirror image on the other side of the face.
        centres = row_start + column, row_start + width - 1 - column
        row_class = _STARTS[5] + row * POSITION_CELLS // height
        column_class = _STARTS[6] + column * POSITION_CELLS // width
        for unit in range(len(hidden)):
            hidden[unit] = (
                shared[unit] + mlp.classes[row_class, unit] + mlp.classes[column_class, unit]
            )
        for feature in range(len(starts)):
            end = starts[feature + 1] if feature + 1 < len(starts) else len(offsets.offsets)
            total = 0
            for term in range(starts[feature], end):
                total += grids[centres[offsets.sides[term]] + offsets.offsets[term]]
            if not total:
                continue
            value = logarithm[min(abs(total), len(logarithm) - 1)]
            if total < 0:
                value = -value
            for unit in range(len(hidden)):
                hidden[unit] += value * mlp.features[feature, unit]
        logits[:] = mlp.bias
        for unit in range(len(hidden)):
            value = np.floor(hidden[unit] * 2.0 ** (HIDDEN_BITS - WEIGHT_BITS))
            value = min(max(value, 0.0), MAX_HIDDEN)
            if value:
                for output in range(len(logits)):
                    logits[output] += value * mlp.output[unit, output]
        for output in range(len(logits)):
            logit = int(np.floor(logits[output] * 2.0**-WEIGHT_BITS))
            p0[k, output] = tables.sigmoid[min(max(logit + MAX_LOGIT, 0), len(tables.sigmoid) - 1)]


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

    p0: (n, outputs), see `probability_model.Networks`.  zero_bits: see `ZERO_BITS`.
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
