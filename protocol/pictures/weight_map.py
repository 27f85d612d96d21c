"""How finely each part of a texture is coded: a coarse map that goes with it.

A texel that covers much of the pictures deserves a finer step than one that covers little of them.
Planes are multiplied by the relief before they are quantised, all with one step, and divided by it
when they are decoded.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import BitCoder, RangeDecoder, RangeEncoder
from protocol.errors import ProtocolError

Array = NDArray[np.float64]

# Cells a side; octaves between neighbouring values and of the whole range.
GRID_SIDE = 12
STEP_OCTAVES = 0.5
RANGE_OCTAVES = (-1.0, 1.5)


def encode_weight_map(weights: Array) -> bytes:
    """The bytes of a relief (SIDE, SIDE), each value > 0 and 1 for a usual texel."""
    octaves = np.clip(np.log2(weights), *RANGE_OCTAVES)
    coder = RangeEncoder()
    _code(coder, np.rint(octaves / STEP_OCTAVES).astype(np.int64))
    return coder.finish()


def decode_weight_map(name: str, data: bytes, height: int, width: int) -> Array:
    """The relief (height, width), continuous from cell to cell; of no bytes it is 1 everywhere.

    name: what it belongs to, for the message.  Raises `ProtocolError` if `data` holds none.
    """
    if not data:
        return np.ones((height, width))
    coder = RangeDecoder(data)
    try:
        steps = _code(coder, np.zeros((GRID_SIDE, GRID_SIDE), np.int64))
    except ValueError as error:
        raise ProtocolError(f"{name}: relief: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: relief: {coder.unread_bytes} bytes too many")
    cells = np.exp2(np.clip(steps * STEP_OCTAVES, *RANGE_OCTAVES))
    return np.asarray(_interpolation_weights(height) @ cells @ _interpolation_weights(width).T)


def _code(coder: BitCoder, steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Code values (SIDE, SIDE), each as what it differs from the one before it or above."""
    integers = AdaptiveIntegers(3)
    known = np.zeros((GRID_SIDE + 1, GRID_SIDE + 1), np.int64)
    for i in range(GRID_SIDE):
        for j in range(GRID_SIDE):
            above, before = int(known[i, j + 1]), int(known[i + 1, j])
            context = min(2, abs(above - before))
            predicted = before if j else above
            rest = integers.code(coder, context, int(steps[i, j]) - predicted)
            known[i + 1, j + 1] = predicted + rest
    return known[1:, 1:]


def _interpolation_weights(count: int) -> Array:
    """(count, SIDE) what each texel in a row takes of each cell's value: linear between middles."""
    places = (np.arange(count) + 0.5) * GRID_SIDE / count - 0.5
    return np.stack(
        [np.interp(places, np.arange(GRID_SIDE), cell) for cell in np.eye(GRID_SIDE)], axis=1
    )
