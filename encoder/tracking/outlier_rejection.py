"""Which points the filter should not believe: those that stay far off where the others go."""

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import jit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Trial updates: enough for the weights to settle.
IRLS_ROUNDS = 10
# The median of the root mean square of two normal deviates.
MEDIAN_RMS = 0.83


@jit
def robust_residuals(
    known: Array, towards: Array, H: Array, innovation: Array, weight: Array, visible: Mask
) -> tuple[Array, float]:
    """(n,) how far off each point stays after an update, and how far off points usually are.

    Points are reweighted from trial to trial (Cauchy), so that those that move together but apart
    from the majority, such as a hand's, let go of the state.  Both results are in standard
    deviations of a coordinate; the second is no less than 1.

    known, towards: (m, m) and (m,), the normal equations of all that is known but for the points.
    H: (2n, r) Jacobian of the points, by the first r entries of the state: the others do not move
    them.  innovation, weight: (2n,), weight 0 where a point is not seen.
    visible: (n,), at least one.
    """
    rows, rigid = H.shape
    normal, right = np.empty_like(known), np.empty_like(towards)
    trial, off, crowd = weight.copy(), np.zeros(len(visible)), 1.0
    for _ in range(IRLS_ROUNDS):
        # The gain in information form: a small inverse, whatever the number of points.
        normal[:], right[:] = known, towards
        for row in range(rows):
            if trial[row] > 0:
                for i in range(rigid):
                    share = trial[row] * H[row, i]
                    right[i] += share * innovation[row]
                    for j in range(rigid):
                        normal[i, j] += share * H[row, j]
        step = np.linalg.solve(normal, right)
        for point in range(len(visible)):
            # Per axis, so that 1 is usual whatever the number of axes.
            mean = 0.0
            for row in (2 * point, 2 * point + 1):
                left = innovation[row]
                for i in range(rigid):
                    left -= H[row, i] * step[i]
                mean += left * left * weight[row] / 2
            off[point] = np.sqrt(mean)
        crowd = max(1.0, float(np.median(off[visible])) / MEDIAN_RMS)
        for row in range(rows):
            trial[row] = weight[row] / (1 + (off[row // 2] / crowd) ** 2)
    return off, crowd
