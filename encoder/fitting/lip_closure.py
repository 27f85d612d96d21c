"""The constraint that the lips meet at rest, for frames in which the mouth is open."""

import numpy as np

from encoder.detection.landmark_indices import INNER_LIP_PAIRS
from shared_model.arrays import Array, Indices

LIP_GAP_SIGMA_MM = 0.3


def lip_closure_constraints(
    index: Indices, neutral: Array, generic: Array, aau: Array, residual: Array
) -> tuple[Array, Array]:
    """Rows (15, 11 + 3 k) and residuals (15,), in sigmas: the lips' gap at rest equals `generic`'s.

    index: (m,) ascending, indices of the points in the network.  neutral, generic: (m, 3) mm, of
    the person and of the generic head.  aau: (11, m, 3) mm.  residual: (k, m) weight of each
    control point.  Columns: AAUs, then x, y, z of each control point.
    """
    upper, lower = (np.searchsorted(index, points) for points in INNER_LIP_PAIRS)
    aau_columns = np.moveaxis(aau[:, upper] - aau[:, lower], 0, 2)
    weight = residual[:, upper] - residual[:, lower]
    controls = np.einsum("km,ij->mikj", weight, np.eye(3)).reshape(len(upper), 3, -1)
    rows = np.concatenate([aau_columns, controls], 2)
    displacement = neutral - generic
    gap = (displacement[lower] - displacement[upper]).ravel()
    return rows.reshape(-1, rows.shape[2]) / LIP_GAP_SIGMA_MM, gap / LIP_GAP_SIGMA_MM
