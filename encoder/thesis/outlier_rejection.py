"""Outlier rejection: residuals of points after a robust update (IRLS, Cauchy)."""

import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array, Mask

# Rounds of reweighting, enough for the weights to converge.
IRLS_ROUNDS = 10
# Median of the root mean square of two standard normal variables.
MEDIAN_RMS = 0.83


@jit
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
    rows, rigid = H.shape
    normal, right = np.empty_like(prior_normal), np.empty_like(prior_right)
    robust, residuals, scale = weight.copy(), np.zeros(len(visible)), 1.0
    for _ in range(IRLS_ROUNDS):
        # The gain in information form: the inverse is small, whatever the number of points.
        normal[:], right[:] = prior_normal, prior_right
        for row in range(rows):
            if robust[row] > 0:
                for i in range(rigid):
                    share = robust[row] * H[row, i]
                    right[i] += share * innovation[row]
                    for j in range(rigid):
                        normal[i, j] += share * H[row, j]
        step = np.linalg.solve(normal, right)
        for point in range(len(visible)):
            mean_square = 0.0
            for row in (2 * point, 2 * point + 1):
                residual = innovation[row]
                for i in range(rigid):
                    residual -= H[row, i] * step[i]
                mean_square += residual * residual * weight[row] / 2
            residuals[point] = np.sqrt(mean_square)
        scale = max(1.0, float(np.median(residuals[visible])) / MEDIAN_RMS)
        for row in range(rows):
            robust[row] = weight[row] / (1 + (residuals[row // 2] / scale) ** 2)
    return residuals, scale
