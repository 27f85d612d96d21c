"""How the light on the layers around a face changes: one gain and one offset of all colours.

A frame shows (1 + g) (v - 128) + 128 + o where the layers have the grey level v, 0 to 255.
"""

from typing import NamedTuple

import numpy as np

from shared_model.arrays import Array

# The grey level that a gain leaves as it is.
PIVOT_GREY = 128.0
# Gain and offset (grey levels) for a coefficient of 1: both change a picture by about as much.
UNIT_GAIN, UNIT_GREY = 0.02, 1.0


class Light(NamedTuple):
    """What light does to a picture.

    gain: 0 or more; 1 changes nothing.  offset: grey levels.
    """

    gain: float
    offset: float


SAME_LIGHT = Light(1.0, 0.0)


def light_of(coefficients: Array) -> Light:
    """The light of a frame.  coefficients: (2,) of gain and offset; missing ones are 0."""
    gain, offset = np.pad(coefficients[:2].astype(np.float64), (0, 2))[:2]
    return Light(max(1 + UNIT_GAIN * float(gain), 0.0), UNIT_GREY * float(offset))
