"""Bilateral symmetry: the near half of a turned face replaces the far half (thesis Fig. 4.5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import FitTarget, Observation, TexelFit, TexelFitter
from encoder.thesis.prediction_matrix import PredictionMatrixFitter, with_coefficients
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.arrays import Indices, Mask, Picture, Single
from shared_model.geometry import euler_deg, matrix_from_quaternion
from shared_model.parameters import FaceParameters

# Yaw beyond which the far half is too foreshortened to be compared.
MIRROR_DEG = 20.0


class HalfFaces:
    """The faces made of one half of a person's face.

    face, shape: of the person, see `TexelFitter`.  whole: all texels of the atlas.
    """

    def __init__(self, face: Face, shape: ShapeFreeFrame, whole: Atlas) -> None:
        self._halves = {left: _half_face(face, shape, whole, left) for left in (False, True)}

    def side_at(self, face: FaceParameters) -> int:
        """1: the left half is near and the other far; -1: the right one; 0: neither is far."""
        if abs(euler_deg(face.pose)[1]) <= MIRROR_DEG:
            return 0
        return 1 if matrix_from_quaternion(face.pose.rotation)[2, 0] < 0 else -1

    def side_of(self, shape: ShapeFreeFrame) -> int:
        """The side whose target has this shape; 0: neither."""
        return next((1 if left else -1 for left, h in self._halves.items() if h.shape is shape), 0)

    def target(self, side: int, whole: Template) -> FitTarget:
        """The face made of the near half of a `side` other than 0, under the whole's template."""
        half = self._halves[side > 0]
        return FitTarget(half.shape, half.template_of(whole))


class SymmetricTexelFitter(TexelFitter):
    """A `TexelFitter` that compares a turned face's far half with the picture of the near half.

    A texel of the far half is sampled at the position of its mirror image on the near half.
    """

    def __init__(
        self,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        normalise: Callable[[Picture], Single] = luma_f32,
    ) -> None:
        super().__init__(face, shape, template, normalise)
        self._halves = HalfFaces(face, self.shape, shape.atlas)

    def observe(self, crop: Crop, initial: FaceParameters) -> Observation:
        """See `TexelFitter`."""
        side = self._halves.side_at(initial)
        if not side:
            return super().observe(crop, initial)
        return self._observe(self._halves.target(side, self.template), crop, initial)

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int],
    ) -> TexelFit:
        """See `TexelFitter`."""
        count = len(observation.target.template.modes)
        padded = with_coefficients(start, start.modes, count)
        result = super().fit(observation, padded, iterations, active)
        whole = len(self.template.modes)
        face = with_coefficients(result.face, result.face.modes, whole)
        return replace(result, face=face)


class MirroredMatrixFitter(PredictionMatrixFitter):
    """A `PredictionMatrixFitter` whose views of turned faces have the near half on both sides.

    A matrix of such a view is trained as it is used: the far half displaced as the near one.
    """

    def __init__(
        self,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        normalise: Callable[[Picture], Single] = luma_f32,
    ) -> None:
        super().__init__(face, shape, template, normalise)
        self._halves = HalfFaces(face, self.shape, shape.atlas)

    def _side_at(self, face: FaceParameters) -> int:
        return self._halves.side_at(face)

    def _side_of(self, observation: Observation) -> int:
        return self._halves.side_of(observation.target.shape)

    def _target_of(self, side: int) -> FitTarget:
        if not side:
            return super()._target_of(side)
        return self._halves.target(side, self.template)


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


def _half_face(face: Face, shape: ShapeFreeFrame, whole: Atlas, left: bool) -> _HalfFace:
    """The face made of one half, left being where x is positive."""
    atlas = shape.atlas
    x = atlas.points(face.neutral)[:, 0]
    far = (x < 0) if left else (x > 0)
    corners, weights, valid = atlas.corners.copy(), atlas.weights.copy(), ~far
    mirrored = mirror_index(whole)[atlas.rows[far], atlas.columns[far]]
    corners[far], weights[far] = whole.corners[mirrored], whole.weights[mirrored]
    valid[far] = mirrored >= 0
    half = Atlas(atlas.size, atlas.rows, atlas.columns, corners, weights)
    light = np.stack([far, far * x / np.abs(x).max()]).astype(np.float32)
    return _HalfFace(ShapeFreeFrame(face, half, shape.camera), valid, light)


def mirror_index(atlas: Atlas) -> Indices:
    """(size, size) index of the texel at the mirrored position of the atlas; -1 where unused."""
    index = np.full((atlas.size, atlas.size), -1, np.intp)
    index[atlas.rows, atlas.columns] = np.arange(len(atlas.rows))
    return index[:, ::-1]
