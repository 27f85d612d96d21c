"""The tracking template: the luma that a fit compares a picture's texels with."""

from dataclasses import dataclass

from shared_model.arrays import Mask, Single


@dataclass(frozen=True, slots=True)
class Template:
    """A linear model of the texels' luma: mean + coefficients @ modes.

    mean: (k,).  modes: (m, k).  weight: (k,) of the squared error of each texel.
    """

    mean: Single
    modes: Single
    weight: Single

    def subset(self, kept: Mask) -> "Template":
        """The template of the texels `kept` (k,) alone."""
        return Template(self.mean[kept], self.modes[:, kept], self.weight[kept])
