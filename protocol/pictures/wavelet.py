"""Biorthogonal 9/7 wavelets (Cohen, Daubechies & Feauveau 1992) by lifting.

The transform is in floating point: nothing is predicted from its output.
"""

from collections.abc import Sequence

import numpy as np

from shared_model.arrays import Array

LEVELS = 5
# Lifting steps, and the gain that makes the wavelets nearly orthonormal.
_LIFT = (-1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971)
_GAIN = 1.149604398860241


def transform(plane: Array, levels: int) -> tuple[Array, list[list[Array]]]:
    """The lowpass band, and the three detail bands of each level, the coarsest level first."""
    details: list[list[Array]] = []
    lowpass = np.asarray(plane, dtype=np.float64)
    for _ in range(levels):
        low, high = _split(lowpass)
        (lowpass, horizontal), (vertical, both) = _split(low.T), _split(high.T)
        lowpass = lowpass.T
        details.append([horizontal.T, vertical.T, both.T])
    return lowpass, details[::-1]


def inverse_transform(lowpass: Array, details: Sequence[Sequence[Array]]) -> Array:
    """The inverse of `transform`."""
    for horizontal, vertical, both in details:
        lowpass = _join(_join(lowpass.T, horizontal.T).T, _join(vertical.T, both.T).T)
    return lowpass


def _split(rows: Array) -> tuple[Array, Array]:
    even, odd = rows[0::2].copy(), rows[1::2].copy()
    if not len(odd):
        return even, odd
    for index, factor in enumerate(_LIFT):
        if index % 2:
            even += factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd += factor * (even[: len(odd)] + _next(even, len(odd)))
    return even * _GAIN, odd / _GAIN


def _join(low: Array, high: Array) -> Array:
    if not len(high):
        return low
    even, odd = low / _GAIN, high * _GAIN
    for index, factor in reversed(tuple(enumerate(_LIFT))):
        if index % 2:
            even -= factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd -= factor * (even[: len(odd)] + _next(even, len(odd)))
    rows = np.empty((len(even) + len(odd), even.shape[1]))
    rows[0::2], rows[1::2] = even, odd
    return rows


def _next(even: Array, count: int) -> Array:
    """For each odd row the even row after it, mirrored at the end."""
    return np.concatenate([even[1:], even[-1:]])[:count]


def _earlier(odd: Array, count: int) -> Array:
    """For each even row the odd row before it, mirrored at the start."""
    return np.concatenate([odd[:1], odd])[:count]


def _later(odd: Array, count: int) -> Array:
    """For each even row the odd row after it, mirrored at the end."""
    return np.concatenate([odd, odd[-1:]])[:count]
