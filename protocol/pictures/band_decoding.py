"""Decoding of one subband in compiled loops.

They read the same symbols as `plane_decoding.ArrayBandDecoder` and let other threads run meanwhile.
The range decoder's registers are (code, range, position).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import (
    LEAST_RANGE,
    PROBABILITY_BITS,
    PROBABILITY_ONE,
    RangeDecoder,
)
from protocol.pictures.coefficient_coding import LONGEST, STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.coefficient_context import context_offsets
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
from protocol.runtime.jit import jit

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

_STEP_OUTPUTS = np.array(STEP_OUTPUTS)
# What stands for a magnitude that no encoder writes.
_TOO_LARGE = -1


@dataclass(frozen=True, slots=True)
class CompiledBandDecoder:
    """A `plane_decoding.BandDecoder`."""

    coder: RangeDecoder

    def tile_flags(self, position: BandPosition, context_bands: Integers) -> Integers:
        """See `plane_decoding.BandDecoder`."""
        tiles, _ = context_offsets(context_bands.shape[1], context_bands.shape[2])
        predictor = make_predictor(probability_models().tiles, tiles)
        with self.coder.registers() as (data, registers):
            return _flags(data, registers, context_bands, _fields(position), predictor)

    def coefficients(
        self, position: BandPosition, context_bands: Integers, active: Bools, tile_flags: Integers
    ) -> Integers:
        """See `plane_decoding.BandDecoder`."""
        of_magnitudes, of_signs = context_offsets(*active.shape)
        models = probability_models()
        with self.coder.registers() as (data, registers):
            values, is_valid = _coefficients(
                data,
                registers,
                (context_bands, active, tile_flags),
                _fields(position),
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
            flags[rows[k], columns[k]] = _bit(data, registers, p0[k, 0])
        add_to_context(rows[here], columns[here], flags, grids, values)
    return flags


@jit
def _coefficients(
    data: Bytes,
    registers: Integers,
    context: tuple[Integers, Bools, Integers],
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
            is_negative = _bit(data, registers, sign_p0[index, 0])
            coefficients[rows[k], columns[k]] = -magnitudes[k] if is_negative else magnitudes[k]
        add_to_context(*signed, coefficients, magnitude_grids, value_grids)
    return coefficients, True


@jit
def _magnitude(data: Bytes, registers: Integers, p0: Integers) -> int:
    """A magnitude; p0: (outputs,), see `probability_model.ProbabilityModels`."""
    for reached in range(UNARY_LIMIT):
        if not _bit(data, registers, p0[_STEP_OUTPUTS[reached]]):
            return reached
    length = 0
    while _bit(data, registers, PROBABILITY_ONE // 2):
        length += 1
        if length > LONGEST:
            return _TOO_LARGE
    excess = 1
    for _ in range(length):
        excess = 2 * excess + _bit(data, registers, PROBABILITY_ONE // 2)
    return UNARY_LIMIT + excess - 1


@jit
def _bit(data: Bytes, registers: Integers, zero: int) -> int:
    """The next bit, which is 0 with probability `zero` / 65536, see `RangeDecoder.code_bit`."""
    split = (registers[1] >> PROBABILITY_BITS) * zero
    bit = int(registers[0] >= split)
    if bit:
        registers[0] -= split
        registers[1] -= split
    else:
        registers[1] = split
    while registers[1] < LEAST_RANGE:
        byte = int(data[registers[2]]) if registers[2] < len(data) else 0
        registers[0] = registers[0] << 8 | byte
        registers[1] <<= 8
        registers[2] += 1
    return bit
