"""The Cauchy weight of robust least squares: the larger a residual, the less it counts."""

import numpy as np

from shared_model.arrays import Single

# Around the face residuals of so many grey levels count half.
HALF_WEIGHT_GREY = 12.0


def cauchy_weight(
    residual: Single, scale_grey: float | np.float32 = HALF_WEIGHT_GREY, weight: Single | float = 1
) -> Single:
    """Weights of iteratively reweighted least squares, of the shape of `residual`, grey levels.

    scale_grey: residuals of so many count half.  weight: of each residual besides.
    """
    return np.asarray(weight / (1 + (residual / scale_grey) ** 2))
