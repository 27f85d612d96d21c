"""Wavelet coefficients as decisions of a range coder.

A decoder runs the same code; it ignores the values it is given and returns those it reads.
"""

import numpy as np

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import BitCoder
from shared_model.arrays import Integers

# Magnitudes have a unary code up to this one; the excess of larger ones has an Exp-Golomb code.
UNARY_LIMIT = 60
# The output of `ProbabilityModels.sizes` that gives the probability of each unary decision.
STEP_OUTPUTS = (0, 1, 2, 3, 3, 4, 4, 4, 4, *[5] * (UNARY_LIMIT - 9))
LONGEST = 14
MAX_MAGNITUDE = UNARY_LIMIT + (2 << LONGEST) - 2


def code_lowpass_band(
    coder: BitCoder, integers: AdaptiveIntegers, context: int, band: Integers
) -> Integers:
    """Code a lowpass band (h, w), each value predicted by the plane through three neighbours.

    Returns the values coded.  Raises `ValueError` if a residual is too large.
    """
    height, width = band.shape
    known = np.zeros((height + 1, width + 1), dtype=np.int64)
    for i in range(height):
        for j in range(width):
            above, left, corner = known[i, j + 1], known[i + 1, j], known[i, j]
            predicted = above + left - corner if i and j else above + left + corner
            residual = integers.code(coder, context, int(band[i, j] - predicted))
            known[i + 1, j + 1] = predicted + residual
    return known[1:, 1:]
