"""Bilateral symmetry: the near half of a turned face replaces the far half (thesis Fig. 4.5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import FitTarget, Observation, TexelFit, TexelFitter
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.arrays import Indices, Mask, Picture, Single
from shared_model.geometry import euler_deg, matrix_from_quaternion
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

# Yaw beyond which the far half is too foreshortened to be compared.
MIRROR_DEG = 20.0


class SymmetricTexelFitter(TexelFitter):
    """A `TexelFitter` that compares a turned face's far half with the picture of the near half.

    A texel of the far half is sampled at the position of its mirror image on the near half.
    """

    def __init__(
        self,
        head: Head,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        normalise: Callable[[Picture], Single] = luma_f32,
    ) -> None:
        super().__init__(head, face, shape, template, normalise)
        self._halves = {left: self._half_face(shape.atlas, left) for left in (False, True)}

    def observe(self, crop: Crop, initial: FaceParameters) -> Observation:
        """See `TexelFitter`."""
        if abs(euler_deg(initial.pose)[1]) <= MIRROR_DEG:
            return super().observe(crop, initial)
        left_is_near = matrix_from_quaternion(initial.pose.rotation)[2, 0] < 0
        half = self._halves[bool(left_is_near)]
        return self._observe(FitTarget(half.shape, half.template_of(self.template)), crop, initial)

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int],
    ) -> TexelFit:
        """See `TexelFitter`."""
        padded = _padded(start, len(observation.target.template.modes))
        result = super().fit(observation, padded, iterations, active)
        return replace(result, face=_padded(result.face, len(self.template.modes)))

    def _half_face(self, whole: Atlas, left: bool) -> "_HalfFace":
        """The face made of one half, left being where x is positive.  whole: all texels."""
        atlas = self.shape.atlas
        x = atlas.points(self._face.neutral)[:, 0]
        far = (x < 0) if left else (x > 0)
        corners, weights, valid = atlas.corners.copy(), atlas.weights.copy(), ~far
        mirrored = mirror_index(whole)[atlas.rows[far], atlas.columns[far]]
        corners[far], weights[far] = whole.corners[mirrored], whole.weights[mirrored]
        valid[far] = mirrored >= 0
        half = Atlas(atlas.size, atlas.rows, atlas.columns, corners, weights)
        light = np.stack([far, far * x / np.abs(x).max()]).astype(np.float32)
        return _HalfFace(ShapeFreeFrame(self._face, half, self.shape.camera), valid, light)


@dataclass(frozen=True, slots=True)
class _HalfFace:
    """A face made of one half.

    shape: each texel of the near half, and the mirror image of each texel of the far half.
    valid: (k,) whether the texel exists.  light: (2, k) modes of side light on mirrored texels.
    """

    shape: ShapeFreeFrame
    valid: Mask
    light: Single

    def template_of(self, whole: Template) -> Template:
        """The template of the whole face, with the modes of side light."""
        modes = np.concatenate([whole.modes, self.light])
        return replace(whole, modes=modes, weight=whole.weight * self.valid)


def _padded(face: FaceParameters, count: int) -> FaceParameters:
    """The face with `count` coefficients, cut or filled up with zeros."""
    modes = np.zeros(count)
    common = min(count, len(face.modes))
    modes[:common] = face.modes[:common]
    return replace(face, modes=modes)


def mirror_index(atlas: Atlas) -> Indices:
    """(size, size) index of the texel at the mirrored position of the atlas; -1 where unused."""
    index = np.full((atlas.size, atlas.size), -1, np.intp)
    index[atlas.rows, atlas.columns] = np.arange(len(atlas.rows))
    return index[:, ::-1]
