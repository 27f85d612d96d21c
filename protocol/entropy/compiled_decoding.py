"""Decoding of bits in compiled loops, which let other threads run meanwhile.

They read the same bits as `range_coder.RangeDecoder` and `adaptive_models.AdaptiveBits`.  The range
decoder's registers are (code, range, position), see `RangeDecoder.registers`.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import MAX_COUNT, MIN_PROBABILITY
from protocol.entropy.range_coder import (
    LEAST_RANGE,
    PROBABILITY_BITS,
    PROBABILITY_ONE,
    RangeDecoder,
)
from runtime.jit import jit
from shared_model.arrays import Integers

Bytes = NDArray[np.uint8]


@jit
def read_bit(data: Bytes, registers: Integers, zero: int) -> int:
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


def decode_bit_map(coder: RangeDecoder, side: int, offsets: Integers) -> Integers:
    """A map (side, side) of adaptive bits, row by row, each in the context of bits before it.

    offsets: (k, 2) rows above and columns to the left of a cell: the bits of its context, the
        highest first.  Bits outside the map are 0.
    """
    with coder.registers() as (data, registers):
        return _bit_map(data, registers, side, offsets)


@jit
def _bit_map(data: Bytes, registers: Integers, side: int, offsets: Integers) -> Integers:
    zeros = np.full(1 << len(offsets), PROBABILITY_ONE // 2)
    counts, bits = np.zeros_like(zeros), np.zeros((side, side), np.int64)
    for i in range(side):
        for j in range(side):
            context = 0
            for k in range(len(offsets)):
                row, column = i - offsets[k, 0], j - offsets[k, 1]
                is_inside = row >= 0 and 0 <= column < side
                context = context << 1 | (bits[row, column] if is_inside else 0)
            bits[i, j] = _adaptive_bit(data, registers, zeros, counts, context)
    return bits


@jit
def _adaptive_bit(
    data: Bytes, registers: Integers, zeros: Integers, counts: Integers, context: int
) -> int:
    """The next bit in a context, which adapts, see `AdaptiveBits.code`.

    zeros, counts: (contexts,) the probability of a 0 in each, in 1 / 65536, and the bits so far.
    """
    bit = read_bit(data, registers, zeros[context])
    adapt(zeros, counts, context, bit)
    return bit


@jit
def adapt(zeros: Integers, counts: Integers, context: int, bit: int) -> None:
    """Adapt a context to a bit that was coded in it; zeros, counts: see `_adaptive_bit`."""
    zero, count = zeros[context], counts[context]
    target = 0 if bit else PROBABILITY_ONE
    zero += (target - zero) * 2 // (2 * count + 4)
    zeros[context] = min(max(zero, MIN_PROBABILITY), PROBABILITY_ONE - MIN_PROBABILITY)
    counts[context] = min(count + 1, MAX_COUNT)
