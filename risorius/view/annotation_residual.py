"""What of an annotated face's texture is not explained: by the other faces' mean, or by a model."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from aam.annotation.annotation_file import Annotation, read_annotation
from aam.model import MultiResolutionModel, texture_at
from aam.sampling import normalised_luma, window_px, zero_mean_unit_variance
from aam.texture_frame import texture_frame
from aam.window import shrunk
from shared_model.appearance import Atlas
from shared_model.arrays import Picture, Single

# Faces of a folder that make its mean, at most, and texels a side.
MEAN_OF, SIZE = 60, 128
# Grey level of no residual, of what is outside the face, and levels for a standard deviation of
# the texture.
ZERO, OUTSIDE, LEVELS = 128, 31, 60


class Residual(Protocol):
    """Says what of a face's texture is left."""

    @property
    def name(self) -> str:
        """What the texture is compared with."""

    def of(self, annotation: Annotation) -> tuple[Picture, float] | None:
        """(size, size) uint8 residual in the shape-free frame, and its share of the variance."""


class MeanResidual:
    """The texture less the mean of the folder's other faces, of unit variance each."""

    name = "less the mean of the folder's other faces"

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        chosen = np.linspace(0, len(names) - 1, min(len(names), MEAN_OF)).astype(int)
        self._frame = texture_frame(SIZE, "full")
        self._names = [names[i] for i in chosen]
        self._textures = [
            self._texture(read_annotation(folder / f"{name}.json")) for name in self._names
        ]

    def of(self, annotation: Annotation) -> tuple[Picture, float] | None:
        """See `Residual`; None without other faces."""
        pairs = zip(self._names, self._textures, strict=True)
        others = [texture for name, texture in pairs if name != annotation.name]
        if not others:
            return None
        mean = zero_mean_unit_variance(np.mean(others, axis=0, dtype=np.float32))
        return _drawn(self._frame, self._texture(annotation) - mean)

    def _texture(self, annotation: Annotation) -> Single:
        luma = cv2.cvtColor(annotation.texture, cv2.COLOR_BGR2GRAY)
        small = cv2.resize(luma, (SIZE, SIZE), interpolation=cv2.INTER_AREA).astype(np.float32)
        return zero_mean_unit_variance(small[self._frame.rows, self._frame.columns])


class ModelResidual:
    """The texture less what a trained model makes of it and of the shape (eq. 2.18, 2.22)."""

    name = "less what the model makes of it"

    def __init__(self, model: MultiResolutionModel) -> None:
        self._level, self._warp = model.levels[-1], model.warp(len(model.levels) - 1)
        self._normalisation = model.normalisation
        self._frame = texture_frame(model.sizes[-1], model.frame)

    def of(self, annotation: Annotation) -> tuple[Picture, float] | None:
        """See `Residual`."""
        window = shrunk(annotation.window, window_px(self._frame.size))
        luma = normalised_luma(window, self._normalisation)
        pose = window.pose_to_window(annotation.pose)
        texture = texture_at(self._warp, luma, annotation.shape, pose)
        c = self._level.parameters_of(annotation.shape, texture)
        return _drawn(self._frame, texture - self._level.texture_of(c))


def _drawn(frame: Atlas, residual: Single) -> tuple[Picture, float]:
    picture = np.full((frame.size, frame.size), OUTSIDE, np.uint8)
    picture[frame.rows, frame.columns] = np.clip(ZERO + LEVELS * residual, 0, 255)
    return picture, float((residual**2).mean())
