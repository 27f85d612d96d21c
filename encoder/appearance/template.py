"""The appearance that a fit compares pictures with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Template:
    """The luma that texels should have: mean (k,) + coefficients @ modes (m, k); weight (k,)."""

    mean: Single
    modes: Single
    weight: Single
