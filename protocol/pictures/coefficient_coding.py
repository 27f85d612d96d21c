"""Wavelet coefficients as decisions of a range coder.

A decoder runs the same code and ignores the values it is given.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.frames.value_coding import BitCoder, code_gamma

Integers = NDArray[np.int64]

# Sizes are coded step by step up to this one, what is above by Elias' gamma code; and which output
# of `foresee.Networks.sizes` foretells each step.
UNARY = 60
STEP_OUTPUTS = (0, 1, 2, 3, 3, 4, 4, 4, 4, *[5] * (UNARY - 9))
_LONGEST = 14
MAX_SIZE = UNARY + (2 << _LONGEST) - 2


def code_coarse(
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


def code_bits_each(coder: BitCoder, bits: Integers, zeros: Integers) -> Integers:
    """Bits (n,), each 0 with probability zeros (n,) / 65536.  Returns the bits coded."""
    pairs = zip(bits.tolist(), zeros.tolist(), strict=True)
    return np.array([coder.code_bit(bit, zero) for bit, zero in pairs], np.int64)


def code_sizes(coder: BitCoder, sizes: Integers, zeros: Integers) -> Integers:
    """Sizes (n,) of coefficients; zeros (n, outputs) of them, see `foresee.Networks`.

    Returns the sizes coded.  Raises `ValueError` if one is above `MAX_SIZE`.
    """
    pairs = zip(sizes.tolist(), zeros.tolist(), strict=True)
    return np.array([_code_size(coder, size, zero) for size, zero in pairs], np.int64)


def _code_size(coder: BitCoder, size: int, zeros: list[int]) -> int:
    reached = 0
    while reached < UNARY and coder.code_bit(int(size > reached), zeros[STEP_OUTPUTS[reached]]):
        reached += 1
    return reached if reached < UNARY else UNARY + code_gamma(coder, size - UNARY, _LONGEST)
