"""Wavelet coefficients as decisions of a range coder.

A decoder runs the same code and ignores the values it is given.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.integer_codes import code_exp_golomb
from protocol.entropy.range_coder import BitCoder

Integers = NDArray[np.int64]

# Sizes are coded step by step up to this one, what is above by Elias' gamma code; and which output
# of `foresee.Networks.sizes` foretells each step.
UNARY_LIMIT = 60
STEP_OUTPUTS = (0, 1, 2, 3, 3, 4, 4, 4, 4, *[5] * (UNARY_LIMIT - 9))
_LONGEST = 14
MAX_MAGNITUDE = UNARY_LIMIT + (2 << _LONGEST) - 2


def code_lowpass_band(
    coder: BitCoder, integers: AdaptiveIntegers, context: int, coarse: Integers
) -> Integers:
    """The coarsest subband of a still, each value predicted from the plane through its neighbours.

    Returns the values coded.  Raises `ValueError` if one is too large.
    """
    height, width = coarse.shape
    known = np.zeros((height + 1, width + 1), dtype=np.int64)
    for i in range(height):
        for j in range(width):
            around = known[i, j + 1], known[i + 1, j], known[i, j]
            predicted = sum(around[:2]) - around[2] if i and j else sum(around)
            rest = integers.code(coder, context, int(coarse[i, j] - predicted))
            known[i + 1, j + 1] = predicted + rest
    return known[1:, 1:]


def code_bit_array(coder: BitCoder, bits: Integers, zeros: Integers) -> Integers:
    """Bits (n,), each 0 with probability zeros (n,) / 65536.  Returns the bits coded."""
    pairs = zip(bits.tolist(), zeros.tolist(), strict=True)
    return np.array([coder.code_bit(bit, zero) for bit, zero in pairs], np.int64)


def code_magnitudes(coder: BitCoder, sizes: Integers, zeros: Integers) -> Integers:
    """Sizes (n,) of coefficients; zeros (n, outputs) of them, see `foresee.Networks`.

    Returns the sizes coded.  Raises `ValueError` if one is above `MAX_SIZE`.
    """
    pairs = zip(sizes.tolist(), zeros.tolist(), strict=True)
    return np.array([_code_magnitude(coder, size, zero) for size, zero in pairs], np.int64)


def _code_magnitude(coder: BitCoder, size: int, zeros: list[int]) -> int:
    reached = 0
    while reached < UNARY_LIMIT and coder.code_bit(
        int(size > reached), zeros[STEP_OUTPUTS[reached]]
    ):
        reached += 1
    return (
        reached
        if reached < UNARY_LIMIT
        else UNARY_LIMIT + code_exp_golomb(coder, size - UNARY_LIMIT, _LONGEST)
    )
