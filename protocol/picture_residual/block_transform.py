"""The lapped transform of a picture residual: DCT over time and over blocks, lapped in between.

Each plane of a group of frames is filtered across the borders of its blocks (Tran, Liang and Tu,
"Lapped transform via time-domain pre- and post-filtering", IEEE TSP 2003), then each block is
transformed by a DCT along rows, columns and time.  All steps are orthonormal, so squared errors of
values are squared errors of pixels.
"""

from functools import cache

import numpy as np

from shared_model.arrays import Array, Single


@cache
def dct_matrix(size: int) -> Single:
    """(size, size) orthonormal DCT-II: rows are its functions."""
    k, n = np.arange(size)[:, None], np.arange(size)[None]
    matrix = np.sqrt(2 / size) * np.cos(np.pi * (2 * n + 1) * k / (2 * size))
    matrix[0] /= np.sqrt(2)
    return np.asarray(matrix, np.float32)


@cache
def lapping_matrix(size: int) -> Single:
    """(size, size) the orthonormal filter of the samples around a border of blocks."""
    half = size // 2
    k, n = np.arange(half)[:, None], np.arange(half)[None]
    dct4 = np.sqrt(2 / half) * np.cos(np.pi * (2 * n + 1) * (2 * k + 1) / (4 * half))
    one, mirror = np.eye(half), np.eye(half)[::-1]
    rotation: Array = mirror @ dct_matrix(half).T.astype(np.float64) @ dct4 @ mirror
    butterfly = np.block([[one, mirror], [mirror, -one]]) / np.sqrt(2)
    middle = np.block([[one, np.zeros_like(one)], [np.zeros_like(one), rotation]])
    return np.asarray(butterfly @ middle @ butterfly, np.float32)
