"""Comparison of subband pyramids."""

import numpy as np

from protocol.pictures.subband_pyramid import SubbandPyramid
from shared_model.arrays import Integers


def same(ours: list[SubbandPyramid], theirs: list[SubbandPyramid]) -> bool:
    pairs = zip(ours, theirs, strict=True)
    return all(
        np.array_equal(a, b)
        for one, other in pairs
        for a, b in zip(bands(one), bands(other), strict=True)
    )


def bands(pyramid: SubbandPyramid) -> list[Integers]:
    return [pyramid.lowpass, *(band for level in pyramid.details for band in level)]
