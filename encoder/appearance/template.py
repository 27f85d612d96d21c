"""The tracking template: the luma that a fit compares a picture's texels with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Template:
    """A linear model of the texels' luma: mean + coefficients @ modes.

    mean: (k,).  modes: (m, k).  weight: (k,) of the squared error of each texel.
    """

    mean: Single
    modes: Single
    weight: Single

    def subset(self, kept: NDArray[np.bool_]) -> "Template":
        """The template of the texels `kept` (k,) alone."""
        return Template(self.mean[kept], self.modes[:, kept], self.weight[kept])
