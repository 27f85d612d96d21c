"""Comparison of subband pyramids."""

import numpy as np
from numpy.typing import NDArray

from protocol.pictures.subband_pyramid import SubbandPyramid


def same(ours: list[SubbandPyramid], theirs: list[SubbandPyramid]) -> bool:
    pairs = zip(ours, theirs, strict=True)
    return all(
        np.array_equal(a, b)
        for one, other in pairs
        for a, b in zip(bands(one), bands(other), strict=True)
    )


def bands(pyramid: SubbandPyramid) -> list[NDArray[np.int64]]:
    return [pyramid.lowpass, *(band for level in pyramid.details for band in level)]
