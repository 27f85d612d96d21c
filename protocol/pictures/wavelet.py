"""Biorthogonal 9/7 wavelets (Cohen, Daubechies & Feauveau 1992) by lifting.

The transform is in floating point: nothing is predicted from its output.
"""

from collections.abc import Sequence

import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array

LEVELS = 5
# Lifting steps, and the gain that makes the wavelets nearly orthonormal.
_LIFT = (-1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971)
_GAIN = 1.149604398860241


def transform(plane: Array, levels: int) -> tuple[Array, list[list[Array]]]:
    """The lowpass band, and the three detail bands of each level, the coarsest level first."""
    details: list[list[Array]] = []
    lowpass = np.ascontiguousarray(plane, dtype=np.float64)
    for _ in range(levels):
        low, high = _split_rows(lowpass)
        lowpass, horizontal = _split_columns(low)
        details.append([horizontal, *_split_columns(high)])
    return lowpass, details[::-1]


def inverse_transform(lowpass: Array, details: Sequence[Sequence[Array]]) -> Array:
    """The inverse of `transform`."""
    for horizontal, vertical, both in details:
        lowpass = _join_rows(_join_columns(lowpass, horizontal), _join_columns(vertical, both))
    return lowpass


@jit
def _split_rows(plane: Array) -> tuple[Array, Array]:
    even, odd = plane[0::2].copy(), plane[1::2].copy()
    if len(odd):
        for index in range(len(_LIFT)):
            _lift(even, odd, index, _LIFT[index])
        even *= _GAIN
        odd /= _GAIN
    return even, odd


@jit
def _split_columns(plane: Array) -> tuple[Array, Array]:
    even, odd = plane[:, 0::2].copy(), plane[:, 1::2].copy()
    if odd.shape[1]:
        for row in range(len(plane)):
            for index in range(len(_LIFT)):
                _lift(even[row], odd[row], index, _LIFT[index])
        even *= _GAIN
        odd /= _GAIN
    return even, odd


@jit
def _join_rows(low: Array, high: Array) -> Array:
    if not len(high):
        return low.copy()
    even, odd = low / _GAIN, high * _GAIN
    for index in range(len(_LIFT) - 1, -1, -1):
        _lift(even, odd, index, -_LIFT[index])
    plane = np.empty((len(even) + len(odd), even.shape[1]))
    plane[0::2], plane[1::2] = even, odd
    return plane


@jit
def _join_columns(low: Array, high: Array) -> Array:
    if not high.shape[1]:
        return low.copy()
    even, odd = low / _GAIN, high * _GAIN
    for row in range(len(low)):
        for index in range(len(_LIFT) - 1, -1, -1):
            _lift(even[row], odd[row], index, -_LIFT[index])
    plane = np.empty((len(even), even.shape[1] + odd.shape[1]))
    plane[:, 0::2], plane[:, 1::2] = even, odd
    return plane


@jit
def _lift(even: Array, odd: Array, index: int, factor: float) -> None:
    """Lifting step `index` along the first axis: even samples or rows change by the odd ones beside
    them, or the other way round; at the ends these are mirrored.
    """
    last_even, last_odd = len(even) - 1, len(odd) - 1
    if index % 2:
        for k in range(len(even)):
            even[k] += factor * (odd[max(k - 1, 0)] + odd[min(k, last_odd)])
    else:
        for k in range(len(odd)):
            odd[k] += factor * (even[k] + even[min(k + 1, last_even)])
