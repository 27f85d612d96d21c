"""How far a mesh may be warped before a cell folds."""

from itertools import product

import numpy as np

from shared_model.arrays import Array


def max_unfolded_step(grid: Array, motion: Array, min_area: float) -> float:
    """The largest s in [0, 1] for which each corner of grid + s * motion has `min_area` or more.

    grid, motion: (rows, columns, 2) float64.  Without the limit, the skin behind the cheek of a
    turned head would fold.
    """
    (across, moved_across), (down, moved_down) = (
        (np.diff(grid, axis=axis), np.diff(motion, axis=axis)) for axis in (1, 0)
    )
    steps = [1.0]
    for i, j in product((slice(-1), slice(1, None)), repeat=2):
        a, b = across[i], down[:, j]
        c, d = moved_across[i], moved_down[:, j]
        # The corner's area is constant + linear s + quadratic s^2.
        constant, linear, quadratic = (
            _cross(a, b) - min_area,
            _cross(a, d) + _cross(c, b),
            _cross(c, d),
        )
        risky = (constant > 0) & (constant + np.minimum(linear, 0) + np.minimum(quadratic, 0) < 0)
        if risky.any():
            steps.append(_first_root(constant[risky], linear[risky], quadratic[risky]))
    return min(steps)


def _first_root(constant: Array, linear: Array, quadratic: Array) -> float:
    """The least positive root of polynomials that are positive at 0; infinity if there is none."""
    root = np.sqrt(np.maximum(linear**2 - 4 * quadratic * constant, 0))
    real = linear**2 >= 4 * quadratic * constant
    # This form of the roots is also valid for linear polynomials.
    divisors = np.concatenate([(root - linear)[real], (-root - linear)[real]])
    numerators = np.tile(2 * constant[real], 2)
    return float(np.min(numerators[divisors > 0] / divisors[divisors > 0], initial=np.inf))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
