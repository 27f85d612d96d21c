"""Smooth curves through points, without overshoot: profiles of a face, tracks of a script."""

import numpy as np
from numpy.typing import ArrayLike

from shared_model.arrays import Array


def smooth_curve(x: ArrayLike, places: ArrayLike, values: ArrayLike) -> Array:
    """Values at `x` (n,) of a monotone cubic through points, constant beyond them.

    places: (k,) increasing.  values: (k,).  Slopes at the points after Fritsch and Butland (1984):
    flat at an extremum and at both ends, the harmonic mean of the neighbouring slopes elsewhere.
    Raises ValueError if places do not increase or do not match the values.
    """
    at, knots, heights = (np.asarray(a, dtype=np.float64) for a in (x, places, values))
    if knots.shape != heights.shape or knots.ndim != 1 or not len(knots):
        raise ValueError(f"places have shape {knots.shape}, values {heights.shape}: expected equal")
    step = np.diff(knots)
    if np.any(step <= 0):
        raise ValueError(f"places are {knots.tolist()}, expected them to increase")
    if len(knots) == 1:
        return np.full(at.shape, heights[0])
    slope = _slopes(np.diff(heights) / step)
    at = np.clip(at, knots[0], knots[-1])
    k = np.clip(np.searchsorted(knots, at) - 1, 0, len(step) - 1)
    t = (at - knots[k]) / step[k]
    start = heights[k] * (1 + 2 * t) + slope[k] * step[k] * t
    end = heights[k + 1] * (3 - 2 * t) - slope[k + 1] * step[k] * (1 - t)
    return np.asarray(start * (1 - t) ** 2 + end * t**2)


def _slopes(rate: Array) -> Array:
    before, after = rate[:-1], rate[1:]
    same = before * after > 0
    total = np.where(same, before + after, 1.0)
    inner = np.where(same, 2 * before * after / total, 0.0)
    return np.concatenate([[0.0], inner, [0.0]])
