"""The range coding of a picture's symbols, in compiled loops.

The bytes are those of `protocol.entropy.range_coder.RangeEncoder` and of the functions of
`protocol.pictures.coefficient_coding`, which decide bit by bit.
"""

from collections.abc import Sequence

import numpy as np

from encoder.picture_coding.subband_rdoq import QuantisedBand
from protocol.entropy.range_coder import (
    LEAST_RANGE,
    PROBABILITY_BITS,
    PROBABILITY_ONE,
    TOP_BITS,
    shortest_point,
)
from protocol.pictures.coefficient_coding import LONGEST, STEP_OUTPUTS, UNARY_LIMIT
from runtime.jit import jit
from shared_model.arrays import Integers, Picture

# Bits (n,), and the probabilities of a zero (n,) that they are coded with, in 1/65536.
Decisions = tuple[Integers, Integers]

EVEN = PROBABILITY_ONE // 2
_OUTPUTS = np.array(STEP_OUTPUTS)
_LOW_MASK = (1 << TOP_BITS) - 1
_BYTE_SHIFT = TOP_BITS - 8


class DecisionRecorder:
    """A `BitCoder` that records decisions."""

    def __init__(self) -> None:
        self._recorded: list[tuple[int, int]] = []

    def code_bit(self, bit: int, zero: int) -> int:
        """Record `bit` and the probability `zero` of a zero; returns `bit`."""
        self._recorded.append((bit, zero))
        return bit

    def recorded(self) -> Decisions:
        """What has been recorded."""
        bits, zeros = np.array(self._recorded, np.int64).reshape(-1, 2).T
        return bits, zeros


def band_decisions(band: QuantisedBand) -> Decisions:
    """The decisions of a band in the order in which `protocol.pictures.subband_coding` reads it."""
    # The unary part of a magnitude, and at most so many decisions after it.
    unary = np.minimum(band.magnitudes, UNARY_LIMIT)
    longest = np.where(unary < UNARY_LIMIT, 1, 2 * LONGEST + 1)
    most = int((unary + longest).sum()) + len(band.flags) + len(band.signs)
    decisions = np.zeros((2, most), np.int64)
    count = _list_decisions(
        band.flags,
        band.flag_p0,
        band.magnitudes,
        band.magnitude_p0,
        band.signs,
        band.sign_p0,
        band.pass_ends,
        decisions,
    )
    bits, zeros = decisions[:, :count]
    return bits, zeros


def range_coded(decisions: Sequence[Decisions]) -> bytes:
    """The bytes that a `RangeEncoder` makes of decisions."""
    if not decisions:
        return b""
    bits, zeros = (np.concatenate(arrays) for arrays in zip(*decisions, strict=True))
    # A decision has no less than 1/65536 of the range: no more than 16 bits.  The first byte is for
    # a carry.
    data = np.zeros(2 * len(bits) + 2, np.uint8)
    length, low, size = _code(bits, zeros, data)
    total_bits = 8 * (length - 1) + TOP_BITS
    point = (int.from_bytes(data[:length].tobytes(), "big") << TOP_BITS) + low
    return shortest_point(point, size, total_bits)


@jit
def _code(bits: Integers, zeros: Integers, data: Picture) -> tuple[int, int, int]:
    """Write the bytes that are settled; their number, and low end and size of the range."""
    low, size, length = 0, 1 << TOP_BITS, 1
    for k in range(len(bits)):
        split = (size >> PROBABILITY_BITS) * zeros[k]
        if bits[k]:
            low += split
            size -= split
        else:
            size = split
        if low > _LOW_MASK:
            low &= _LOW_MASK
            place = length - 1
            while data[place] == 255:
                data[place] = 0
                place -= 1
            data[place] += 1
        while size < LEAST_RANGE:
            data[length] = low >> _BYTE_SHIFT
            length += 1
            low = (low << 8) & _LOW_MASK
            size <<= 8
    return length, low, size


@jit
def _list_decisions(
    flags: Integers,
    flag_p0: Integers,
    magnitudes: Integers,
    magnitude_p0: Integers,
    signs: Integers,
    sign_p0: Integers,
    pass_ends: Integers,
    decisions: Integers,
) -> int:
    """Write decisions (2, n), see `Decisions`; the fields of a `QuantisedBand`.  Their number."""
    count = len(flags)
    decisions[0, :count], decisions[1, :count] = flags, flag_p0
    first_magnitude, first_sign = 0, 0
    for number in range(len(pass_ends)):
        for k in range(first_magnitude, pass_ends[number, 0]):
            count = _list_magnitude(magnitudes[k], magnitude_p0[k], decisions, count)
        for k in range(first_sign, pass_ends[number, 1]):
            decisions[0, count], decisions[1, count] = signs[k], sign_p0[k]
            count += 1
        first_magnitude, first_sign = pass_ends[number, 0], pass_ends[number, 1]
    return count


@jit
def _list_magnitude(magnitude: int, p0: Integers, decisions: Integers, count: int) -> int:
    """Write the decisions of a magnitude from `count` on; the number then."""
    for step in range(min(magnitude, UNARY_LIMIT)):
        decisions[0, count], decisions[1, count] = 1, p0[_OUTPUTS[step]]
        count += 1
    if magnitude < UNARY_LIMIT:
        decisions[0, count], decisions[1, count] = 0, p0[_OUTPUTS[magnitude]]
        return count + 1
    return list_exp_golomb(magnitude - UNARY_LIMIT, decisions, count)


@jit
def list_exp_golomb(value: int, decisions: Integers, count: int) -> int:
    """Write the decisions of `integer_codes.code_exp_golomb` from `count` on; the number then.

    decisions: (2, n), see `Decisions`.
    """
    shifted, digits = value + 1, 0
    while shifted >> digits > 1:
        digits += 1
    for place in range(2 * digits + 1):
        below = 2 * digits - place
        bit = 1 if place < digits else 0 if place == digits else shifted >> below & 1
        decisions[0, count], decisions[1, count] = bit, EVEN
        count += 1
    return count
