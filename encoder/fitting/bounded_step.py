"""The step of a least-squares fit within bounds, by an active set.

A step that is clipped only after it was solved leaves what the clipped value would have explained
to nobody; here the other values take it over.
"""

import numpy as np

from shared_model.arrays import Array, Mask

# Of rounding, beyond a bound.
TOLERANCE = 1e-12


def bounded_step(normal: Array, gradient: Array, free: Mask, low: Array, high: Array) -> Array:
    """(n,) x of normal (n, n) x = gradient (n,) where low <= x <= high, each (n,); zero where it is
    not free.  What exceeds a bound stays at it, and the rest is solved again.
    """
    free, solution = np.array(free), np.zeros(len(gradient))
    while free.any():
        left = gradient - normal @ np.where(free, 0.0, solution)
        solution[free] = np.linalg.solve(normal[np.ix_(free, free)], left[free])
        out = free & ((solution < low - TOLERANCE) | (solution > high + TOLERANCE))
        if not out.any():
            break
        solution[out] = np.clip(solution[out], low[out], high[out])
        free &= ~out
    return solution
