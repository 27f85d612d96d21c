"""The visible half of a turned face in place of the other (thesis 4.4, Fig. 4.5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import (
    FitTarget,
    Observation,
    Picture,
    Single,
    TexelFit,
    TexelFitter,
)
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.geometry import euler_deg, matrix_from_quaternion
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

# Yaw beyond which the far half is too much distorted to be looked at.
MIRROR_DEG = 20.0


class SymmetricTexelFitter(TexelFitter):
    """A `Refiner` that takes the far half of a turned face from the near one.

    What a texel of the far half should look like is then compared with its twin of the near half.
    """

    def __init__(
        self,
        head: Head,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        grey: Callable[[Picture], Single] = luma_f32,
    ) -> None:
        super().__init__(head, face, shape, template, grey)
        self._halves = {left: self._half(shape.atlas, left) for left in (False, True)}

    def look(self, crop: Crop, near: FaceParameters) -> Observation:
        """See `Refiner`."""
        if abs(euler_deg(near.pose)[1]) <= MIRROR_DEG:
            return super().observe(crop, near)
        left_is_near = matrix_from_quaternion(near.pose.rotation)[2, 0] < 0
        half = self._halves[bool(left_is_near)]
        return self._observe(FitTarget(half.shape, half.template_of(self.template)), crop, near)

    def explain(
        self, view: Observation, start: FaceParameters, iterations: int, active: Sequence[int]
    ) -> TexelFit:
        """See `Refiner`."""
        padded = _padded(start, len(view.target.template.modes))
        found = super().fit(view, padded, iterations, active)
        return replace(found, face=_padded(found.face, len(self.template.modes)))

    def _half(self, every: Atlas, left: bool) -> "_Half":
        """The face made of one half, left being where x is positive."""
        atlas = self.shape.atlas
        across = atlas.points(self._face.neutral)[:, 0]
        far = (across < 0) if left else (across > 0)
        corners, weights, kept = atlas.corners.copy(), atlas.weights.copy(), ~far
        twin = mirror_index(every)[atlas.rows[far], atlas.columns[far]]
        corners[far], weights[far] = every.corners[twin], every.weights[twin]
        kept[far] = twin >= 0
        mirrored = Atlas(atlas.size, atlas.rows, atlas.columns, corners, weights)
        light = np.stack([far, far * across / np.abs(across).max()]).astype(np.float32)
        return _Half(ShapeFreeFrame(self._face, mirrored, self.shape.camera), kept, light)


@dataclass(frozen=True, slots=True)
class _Half:
    """A face made of one half.

    shape: each texel, or its twin.  kept: (k,) those there are.  light: (2, k) what a light from
    the side does to the mirrored texels alone.
    """

    shape: ShapeFreeFrame
    kept: NDArray[np.bool_]
    light: Single

    def template_of(self, whole: Template) -> Template:
        """The template of the whole face, made to explain this."""
        modes = np.concatenate([whole.modes, self.light])
        return replace(whole, modes=modes, weight=whole.weight * self.kept)


def _padded(face: FaceParameters, count: int) -> FaceParameters:
    """The face with `count` coefficients, cut or filled up with zeros."""
    modes = np.zeros(count)
    shared = min(count, len(face.modes))
    modes[:shared] = face.modes[:shared]
    return replace(face, modes=modes)


def mirror_index(atlas: Atlas) -> NDArray[np.intp]:
    """(size, size) index of the texel that shows the other side of the face; -1: there is none."""
    index = np.full((atlas.size, atlas.size), -1, np.intp)
    index[atlas.rows, atlas.columns] = np.arange(len(atlas.rows))
    return index[:, ::-1]
