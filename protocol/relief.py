"""How finely each part of a texture is coded: a coarse map that goes with it.

A texel that covers much of the pictures deserves a finer step than one that covers little of them.
Planes are multiplied by the relief before they are quantised, all with one step, and divided by it
when they are decoded.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.messages import ProtocolError
from protocol.wavelet import SubbandCoder

Array = NDArray[np.float64]

# Cells a side; octaves between neighbouring values and of the whole range.
SIDE = 12
STEP_OCTAVES = 0.5
RANGE_OCTAVES = (-1.0, 1.5)


def encode_relief(fineness: Array) -> bytes:
    """The bytes of a relief (SIDE, SIDE), each value > 0 and 1 for a usual texel."""
    octaves = np.clip(np.log2(fineness), *RANGE_OCTAVES)
    data, _ = SubbandCoder().encode([octaves], STEP_OCTAVES)
    return data


def decode_relief(name: str, data: bytes, height: int, width: int) -> Array:
    """The relief (height, width), continuous from cell to cell; of no bytes it is 1 everywhere.

    name: what it belongs to, for the message.  Raises `ProtocolError` if `data` holds none.
    """
    if not data:
        return np.ones((height, width))
    try:
        (octaves,) = SubbandCoder().decode(data, [(SIDE, SIDE)], STEP_OCTAVES)
    except ProtocolError as error:
        raise ProtocolError(f"{name}: relief: {error}") from error
    cells = np.exp2(np.clip(octaves, *RANGE_OCTAVES))
    return np.asarray(_shares(height) @ cells @ _shares(width).T)


def _shares(count: int) -> Array:
    """(count, SIDE) what each texel in a row takes of each cell's value: linear between middles."""
    places = (np.arange(count) + 0.5) * SIDE / count - 0.5
    return np.stack([np.interp(places, np.arange(SIDE), cell) for cell in np.eye(SIDE)], axis=1)
