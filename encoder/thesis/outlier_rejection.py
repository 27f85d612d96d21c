"""Outlier rejection: residuals of points after a robust update (IRLS, Cauchy)."""

import numpy as np

from shared_model.arrays import Array, Mask

# Rounds of reweighting, enough for the weights to converge.
IRLS_ROUNDS = 10
# Median of the root mean square of two standard normal variables.
MEDIAN_RMS = 0.83


def robust_residuals(
    prior_normal: Array,
    prior_right: Array,
    H: Array,
    innovation: Array,
    weight: Array,
    visible: Mask,
) -> tuple[Array, float]:
    """Residuals (n,) of points after a robust update, and their scale, which is at least 1.

    Cauchy weights make points that move together but unlike the majority, such as those on a hand,
    lose their influence on the state.  Both results are in standard deviations of a coordinate.

    prior_normal, prior_right: (m, m) and (m,), normal equations of everything but the points.
    H: (2n, r) Jacobian of the points by the first r entries of the state; the others do not move
        points.
    innovation, weight: (2n,), weight 0 where a point is not measured.
    visible: (n,), at least one.
    """
    rigid = H.shape[1]
    normal, right = prior_normal.copy(), prior_right.copy()
    robust = weight
    # No solver of `gauss_newton`: the problem is linear and starts at 0 in each round; only the
    # weights change.
    for _ in range(IRLS_ROUNDS):
        # The gain in information form: the inverse is small, whatever the number of points.
        weighted = H.T * robust
        normal[:rigid, :rigid] = prior_normal[:rigid, :rigid] + weighted @ H
        right[:rigid] = prior_right[:rigid] + weighted @ innovation
        step = np.linalg.solve(normal, right)
        squares = (innovation - H @ step[:rigid]) ** 2 * weight
        residuals = np.sqrt(squares.reshape(-1, 2).mean(axis=1))
        scale = max(1.0, float(np.median(residuals[visible])) / MEDIAN_RMS)
        robust = weight / (1 + (residuals / scale) ** 2).repeat(2)
    return residuals, scale
