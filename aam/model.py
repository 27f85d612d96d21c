"""The trained model: shape, texture and combined modes with their prediction matrices."""

from dataclasses import dataclass

import numpy as np

from aam.pca import LinearModel
from aam.sampling import sample, zero_mean_unit_variance
from aam.warps import HeadWarp, Warp, head_warp
from shared_model.arrays import Array, Single


@dataclass(frozen=True, slots=True, eq=False)
class AppearanceModel:
    """Shape and texture that vary together (thesis eq. 2.17 to 2.20), at one resolution.

    shape: of shapes (n,), n_s modes.  texture: of textures (k,) of zero mean and unit variance.
    shape_weight: W_s, the same for all shape modes.
    combined: of (W_s p_s, p_g), about 0; M modes.
    contrast: share of a texture's variance that the model explains in the training set, mean and
        standard deviation.
    cascade: (stages, p + M, k) predict from a residual the step of pose and c that explains it,
        one after the other.
    additive: (p + M, k) Psi of eq. 2.27; the step is its negative.
    project_out: (p + n_s, k) predicts the step of pose and p_s from a texture less the mean.
    regressed: (p + M, k) as `additive`, by regression on displacements that were drawn.
    Matrices that were not trained have no rows.
    """

    shape: LinearModel
    texture: LinearModel
    shape_weight: float
    combined: LinearModel
    contrast: tuple[float, float]
    cascade: Single
    additive: Single
    project_out: Single
    regressed: Single

    @property
    def deviations(self) -> Array:
        """(M,) standard deviations of c."""
        return np.asarray(np.sqrt(self.combined.variances))

    def shape_of(self, c: Array) -> Array:
        """(..., n) of combined parameters (..., M) (eq. 2.19)."""
        p_s = c @ self.combined.modes[:, : self._shape_count] / self.shape_weight
        return self.shape.values(p_s)

    def texture_of(self, c: Array) -> Single:
        """(..., k) of combined parameters (..., M) (eq. 2.19)."""
        p_g = c @ self.combined.modes[:, self._shape_count :]
        mean, modes = self.texture.mean.astype(np.float32), self.texture.modes
        return np.asarray(mean + p_g.astype(np.float32) @ modes.astype(np.float32, copy=False))

    def parameters_of(self, shape: Array, texture: Single) -> Array:
        """(..., M) combined parameters that come nearest to shapes and textures (eq. 2.18)."""
        p_s = self.shape.coefficients(shape)
        p_g = self.texture.coefficients(texture)
        both = np.concatenate([self.shape_weight * p_s, p_g], axis=-1)
        return self.combined.coefficients(both)

    @property
    def _shape_count(self) -> int:
        return len(self.shape.variances)


@dataclass(frozen=True, slots=True, eq=False)
class MultiResolutionModel:
    """Models of one training set from coarse to fine.

    frame: see `texture_frame`.  normalisation: see `normalised_luma`.
    sizes: texels a side of each level.
    """

    frame: str
    normalisation: str
    sizes: tuple[int, ...]
    levels: tuple[AppearanceModel, ...]

    def warp(self, level: int) -> HeadWarp:
        """The warp of a level."""
        return head_warp(self.sizes[level], self.frame)


def texture_at(warp: Warp, luma: Single, shape: Array, pose: Array) -> Single:
    """(k,) normalised texture under a shape (n,) at a pose (p,) in a picture (h, w)."""
    return zero_mean_unit_variance(sample(luma, warp.positions(shape, pose)))


def residual(model: AppearanceModel, warp: Warp, luma: Single, pose: Array, c: Array) -> Single:
    """(k,) texture of the picture less that of the model (eq. 2.22)."""
    return texture_at(warp, luma, model.shape_of(c), pose) - model.texture_of(c)
