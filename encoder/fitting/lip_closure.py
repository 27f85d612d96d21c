"""The lips of a face at rest meet: what one frame of an open mouth cannot show."""

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import INNER_LIP_PAIRS

Array = NDArray[np.float64]

SIGMA_MM = 0.3


def lip_closure_constraints(
    index: NDArray[np.intp], neutral: Array, rest: Array, aau: Array, residual: Array
) -> tuple[Array, Array]:
    """Rows (15, 11 + 3 k) and residuals (15,), in sigmas, of lips at rest as far apart as `rest`'s.

    index: (m,) ascending, the points' numbers in the network.  neutral, rest: (m, 3) mm, of the
    caller and of the generic head.  aau: (11, m, 3) mm.  residual: (k, m), share of each control
    point.  Columns: AAUs, then x, y, z of each control point.
    """
    upper, lower = (np.searchsorted(index, points) for points in INNER_LIP_PAIRS)
    apart = np.moveaxis(aau[:, upper] - aau[:, lower], 0, 2)
    share = residual[:, upper] - residual[:, lower]
    controls = np.einsum("km,ij->mikj", share, np.eye(3)).reshape(len(upper), 3, -1)
    rows = np.concatenate([apart, controls], 2)
    moved = neutral - rest
    return rows.reshape(-1, rows.shape[2]) / SIGMA_MM, (
        moved[lower] - moved[upper]
    ).ravel() / SIGMA_MM
