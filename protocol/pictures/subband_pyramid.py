"""The quantised wavelet coefficients of a picture plane."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.pictures.probability_model import BandPosition
from protocol.pictures.wavelet import LEVELS, inverse_transform
from shared_model.arrays import Array, Integers

Shape = tuple[int, int]

# A coefficient is reconstructed nearer to zero than the middle of its interval, by so many steps.
RECONSTRUCTION_BIAS = 0.05


@dataclass(frozen=True, slots=True)
class SubbandPyramid:
    """The quantised coefficients of a plane.

    details: three bands a level (orientations 0, 1, 2), the coarsest level first.
    """

    lowpass: Integers
    details: list[list[Integers]]

    def band(self, position: BandPosition) -> Integers:
        """The band of this level and orientation."""
        return position.select(self.lowpass, self.details)


def empty_pyramid(shape: Shape) -> SubbandPyramid:
    """Zeros in the shapes of the bands that `wavelet.transform` makes of a plane."""
    levels: list[list[Integers]] = []
    height, width = shape
    for _ in range(LEVELS):
        low, high = (-(-height // 2), -(-width // 2)), (height // 2, width // 2)
        shapes = ((low[0], high[1]), (high[0], low[1]), high)
        levels.append([np.zeros(each, np.int64) for each in shapes])
        height, width = low
    return SubbandPyramid(np.zeros((height, width), np.int64), levels[::-1])


def plane_shape(details: Sequence[Sequence[NDArray[Any]]]) -> Shape:
    """Height and width of the plane with these details."""
    horizontal, vertical, _ = details[-1]
    return len(horizontal) + len(vertical), horizontal.shape[1] + vertical.shape[1]


def map_bands(function: Callable[..., Integers], *pyramids: SubbandPyramid) -> SubbandPyramid:
    """A function of corresponding bands, applied to all bands of the pyramids."""
    lowpass = function(*(pyramid.lowpass for pyramid in pyramids))
    levels = zip(*(pyramid.details for pyramid in pyramids), strict=True)
    details = [[function(*bands) for bands in zip(*level, strict=True)] for level in levels]
    return SubbandPyramid(lowpass, details)


def dequantised(pyramid: SubbandPyramid, step: float) -> Array:
    """The plane of quantised coefficients, with quantiser step `step`."""
    details = [
        [step * (band - RECONSTRUCTION_BIAS * np.sign(band)) for band in level]
        for level in pyramid.details
    ]
    return inverse_transform((pyramid.lowpass * step).astype(np.float64), details)
