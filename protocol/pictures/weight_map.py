"""Weight maps: spatially adaptive quantisation of a texture and its modes.

A texel that covers many pixels of the frames needs a finer quantiser than one that covers few.  The
planes of a picture are multiplied by the map before quantisation with one step, and divided by it
after decoding.
"""

import numpy as np

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import BitCoder, RangeDecoder, RangeEncoder
from protocol.errors import ProtocolError
from shared_model.arrays import Array, Integers

# Cells along each side; quantiser step and range of the logarithm of the weights, octaves.
GRID_SIDE = 12
STEP_OCTAVES = 0.5
RANGE_OCTAVES = (-1.0, 1.5)


def encode_weight_map(weights: Array) -> bytes:
    """The bytes of weights (GRID_SIDE, GRID_SIDE), each > 0 and 1 for a texel of normal weight."""
    octaves = np.clip(np.log2(weights), *RANGE_OCTAVES)
    coder = RangeEncoder()
    _code(coder, np.rint(octaves / STEP_OCTAVES).astype(np.int64))
    return coder.finish()


def decode_weight_map(name: str, data: bytes, height: int, width: int) -> Array:
    """The weights (height, width), interpolated bilinearly; ones if `data` is empty.

    name: of the picture, for the message.  Raises `ProtocolError` if `data` is damaged.
    """
    if not data:
        return np.ones((height, width))
    coder = RangeDecoder(data)
    try:
        steps = _code(coder, np.zeros((GRID_SIDE, GRID_SIDE), np.int64))
    except ValueError as error:
        raise ProtocolError(f"{name}: weight map: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: weight map: {coder.unread_bytes} bytes too many")
    cells = np.exp2(np.clip(steps * STEP_OCTAVES, *RANGE_OCTAVES))
    return np.asarray(_interpolation_weights(height) @ cells @ _interpolation_weights(width).T)


def _code(coder: BitCoder, steps: Integers) -> Integers:
    """Code (GRID_SIDE, GRID_SIDE) integers, predicted from the left, at the edge from above."""
    integers = AdaptiveIntegers(3)
    known = np.zeros((GRID_SIDE + 1, GRID_SIDE + 1), np.int64)
    for i in range(GRID_SIDE):
        for j in range(GRID_SIDE):
            above, left = int(known[i, j + 1]), int(known[i + 1, j])
            context = min(2, abs(above - left))
            predicted = left if j else above
            residual = integers.code(coder, context, int(steps[i, j]) - predicted)
            known[i + 1, j + 1] = predicted + residual
    return known[1:, 1:]


def _interpolation_weights(count: int) -> Array:
    """(count, GRID_SIDE) weight of each cell at each texel: linear between centres of cells."""
    positions = (np.arange(count) + 0.5) * GRID_SIDE / count - 0.5
    return np.stack(
        [np.interp(positions, np.arange(GRID_SIDE), cell) for cell in np.eye(GRID_SIDE)], axis=1
    )
