"""Decoding of one subband in compiled loops, which let other threads run meanwhile."""

from dataclasses import dataclass

import numpy as np

from protocol.entropy.compiled_decoding import Bytes, read_bit
from protocol.entropy.range_coder import PROBABILITY_ONE, RangeDecoder
from protocol.pictures.coefficient_coding import LONGEST, STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.coefficient_context import (
    SMALL_BAND,
    TILE,
    context_offsets,
    tile_grid,
)
from protocol.pictures.probability_model import BandPosition, probability_models
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
from shared_model.arrays import Integers, Mask

_STEP_OUTPUTS = np.array(STEP_OUTPUTS)
# What stands for a magnitude that no encoder writes.
_TOO_LARGE = -1


@dataclass(frozen=True, slots=True)
class CompiledBandDecoder:
    """A `plane_decoding.BandDecoder`."""

    coder: RangeDecoder

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        """See `plane_decoding.BandDecoder`."""
        shape = context_bands.shape[1:]
        grid = tile_grid(shape)
        of_tiles, _ = context_offsets(*grid)
        of_magnitudes, of_signs = context_offsets(*shape)
        models = probability_models()
        with self.coder.registers() as (data, registers):
            values, is_valid = _band(
                data,
                registers,
                context_bands,
                _fields(position),
                grid,
                make_predictor(models.tiles, of_tiles),
                make_predictor(models.sizes, of_magnitudes),
                make_predictor(models.signs, of_signs),
            )
        if not is_valid:
            raise ValueError("a value is too large")
        return values


def _fields(position: BandPosition) -> Integers:
    return np.array(
        [
            position.kind,
            position.plane,
            position.level,
            position.orientation,
            position.pictures,
        ]
    )


@jit
def _band(
    data: Bytes,
    registers: Integers,
    context_bands: Integers,
    band: Integers,
    grid: tuple[int, int],
    of_tiles: Predictor,
    of_magnitudes: Predictor,
    of_signs: Predictor,
) -> tuple[Integers, bool]:
    """The coefficients (h, w), and whether all are within their limits.  grid: of tiles."""
    shape = context_bands.shape[1], context_bands.shape[2]
    flags = np.ones(grid, np.int64)
    if grid[0] * grid[1] * TILE**2 > SMALL_BAND:
        flags = _flags(data, registers, _tile_sums(context_bands, grid), band, of_tiles)
    active, flags_around = np.empty(shape, np.bool_), np.empty(shape, np.int64)
    for i in range(grid[0]):
        for j in range(grid[1]):
            around = flags[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].sum()
            tile = slice(i * TILE, (i + 1) * TILE), slice(j * TILE, (j + 1) * TILE)
            active[tile], flags_around[tile] = flags[i, j] > 0, around
    context = context_bands, active, flags_around
    return _coefficients(data, registers, context, band, of_magnitudes, of_signs)


@jit
def _tile_sums(context_bands: Integers, grid: tuple[int, int]) -> Integers:
    """(len(ContextBand), *grid) sums of magnitudes over tiles."""
    count, height, width = context_bands.shape
    sums = np.zeros((count, grid[0], grid[1]), np.int64)
    for k in range(count):
        for i in range(height):
            for j in range(width):
                sums[k, i // TILE, j // TILE] += abs(context_bands[k, i, j])
    return sums


@jit
def _flags(
    data: Bytes,
    registers: Integers,
    context_bands: Integers,
    band: Integers,
    predictor: Predictor,
) -> Integers:
    shape = context_bands.shape[1], context_bands.shape[2]
    flags = np.zeros(shape, np.int64)
    rows, columns, starts = list_positions(np.ones(shape, np.bool_))
    grids, values = context_grids(context_bands, flags)
    p0 = np.zeros((len(rows), 1), np.int64)
    for number in range(PASSES):
        here = slice(starts[number], starts[number + 1])
        predict(predictor, band, number, grids, shape, rows[here], columns[here], p0[here])
        for k in range(starts[number], starts[number + 1]):
            flags[rows[k], columns[k]] = read_bit(data, registers, p0[k, 0])
        add_to_context(rows[here], columns[here], flags, grids, values)
    return flags


@jit
def _coefficients(
    data: Bytes,
    registers: Integers,
    context: tuple[Integers, Mask, Integers],
    band: Integers,
    of_magnitudes: Predictor,
    of_signs: Predictor,
) -> tuple[Integers, bool]:
    """The coefficients (h, w), and whether all are within their limits."""
    context_bands, active, tile_flags = context
    shape = context_bands.shape[1], context_bands.shape[2]
    coefficients = np.zeros(shape, np.int64)
    magnitude_grids, value_grids = context_grids(context_bands, tile_flags)
    rows, columns, starts = list_positions(active)
    p0 = np.zeros((len(rows), len(of_magnitudes.output_bias)), np.int64)
    sign_p0 = np.zeros((len(rows), 1), np.int64)
    magnitudes = np.zeros(len(rows), np.int64)
    for number in range(PASSES):
        here = slice(starts[number], starts[number + 1])
        places = rows[here], columns[here]
        predict(of_magnitudes, band, number, magnitude_grids, shape, *places, p0[here])
        for k in range(starts[number], starts[number + 1]):
            magnitudes[k] = _magnitude(data, registers, p0[k])
            if magnitudes[k] == _TOO_LARGE:
                return coefficients, False
        nonzero = np.nonzero(magnitudes[here])[0] + starts[number]
        signed = rows[nonzero], columns[nonzero]
        predict(of_signs, band, number, value_grids, shape, *signed, sign_p0[: len(nonzero)])
        for index in range(len(nonzero)):
            k = nonzero[index]
            is_negative = read_bit(data, registers, sign_p0[index, 0])
            coefficients[rows[k], columns[k]] = -magnitudes[k] if is_negative else magnitudes[k]
        add_to_context(*signed, coefficients, magnitude_grids, value_grids)
    return coefficients, True


@jit
def _magnitude(data: Bytes, registers: Integers, p0: Integers) -> int:
    """A magnitude; p0: (outputs,), see `probability_model.ProbabilityModels`."""
    for reached in range(UNARY_LIMIT):
        if not read_bit(data, registers, p0[_STEP_OUTPUTS[reached]]):
            return reached
    length = 0
    while read_bit(data, registers, PROBABILITY_ONE // 2):
        length += 1
        if length > LONGEST:
            return _TOO_LARGE
    excess = 1
    for _ in range(length):
        excess = 2 * excess + read_bit(data, registers, PROBABILITY_ONE // 2)
    return UNARY_LIMIT + excess - 1
