"""Biorthogonal 9/7 wavelets (Cohen, Daubechies & Feauveau 1992) by lifting.

The transform is floating point: it makes colours, nothing that is predicted from.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVELS = 5
# Lifting steps, and the gain that makes the wavelets nearly orthonormal.
_LIFT = (-1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971)
_GAIN = 1.149604398860241


def transform(plane: Array, levels: int) -> tuple[Array, list[list[Array]]]:
    """The coarsest subband, and the three details of each level, the coarsest level first."""
    details: list[list[Array]] = []
    coarse = np.asarray(plane, dtype=np.float64)
    for _ in range(levels):
        low, high = _split(coarse)
        (coarse, right), (down, both) = _split(low.T), _split(high.T)
        coarse = coarse.T
        details.append([right.T, down.T, both.T])
    return coarse, details[::-1]


def inverse_transform(coarse: Array, details: Sequence[Sequence[Array]]) -> Array:
    """The plane of which `transform` makes these."""
    for right, down, both in details:
        coarse = _join(_join(coarse.T, right.T).T, _join(down.T, both.T).T)
    return coarse


def _split(rows: Array) -> tuple[Array, Array]:
    even, odd = rows[0::2].copy(), rows[1::2].copy()
    if not len(odd):
        return even, odd
    for place, factor in enumerate(_LIFT):
        if place % 2:
            even += factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd += factor * (even[: len(odd)] + _next(even, len(odd)))
    return even * _GAIN, odd / _GAIN


def _join(low: Array, high: Array) -> Array:
    if not len(high):
        return low
    even, odd = low / _GAIN, high * _GAIN
    for place, factor in reversed(tuple(enumerate(_LIFT))):
        if place % 2:
            even -= factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd -= factor * (even[: len(odd)] + _next(even, len(odd)))
    rows = np.empty((len(even) + len(odd), even.shape[1]))
    rows[0::2], rows[1::2] = even, odd
    return rows


def _next(even: Array, count: int) -> Array:
    """For each odd row the even one after it, mirrored at the end."""
    return np.concatenate([even[1:], even[-1:]])[:count]


def _earlier(odd: Array, count: int) -> Array:
    """For each even row the odd one before it, mirrored at the start."""
    return np.concatenate([odd[:1], odd])[:count]


def _later(odd: Array, count: int) -> Array:
    """For each even row the odd one after it, mirrored at the end."""
    return np.concatenate([odd, odd[-1:]])[:count]
