"""The picture of the scene: what stands behind the person, from all frames of a sample.

Where the camera moves, the frames are moved back first: their motion is found by fitting a picture
of the scene to them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import sample
from encoder.layers.layer_samples import MIN_FRAMES, LayerSamples, coarse_luma, luma_at, robust_mean
from encoder.layers.scene_motion import (
    fit_scene_motion,
    is_explained,
    left_of,
    scene_basis,
    scene_origins,
)
from shared_model.appearance import pull_push_fill
from shared_model.layers.scene_motion import displacement_basis

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The matte up to which a pixel shows the scene; its weight falls to 0 there.
CLEAR_MATTE = 0.25


@dataclass(frozen=True, slots=True)
class SceneLayer:
    """The scene of a sample.

    picture: (h, w, 3) BGR.
    motion: (n, 4) in each frame, see `scene_motion`; None: it stands still.
    """

    picture: Single
    motion: Array | None

    def origins(self, number: int, at: Single, size: tuple[int, int]) -> Single:
        """Where positions in frame `number` come from in the picture of the scene.

        at: (h, w, 2) pixels of a picture (h, w).  size: of the source, (width, height).
        """
        if self.motion is None:
            return at
        ratio = np.array(at.shape[1::-1]) / np.array(size)
        basis = displacement_basis(*size, (at + 0.5) / ratio - 0.5)
        return np.asarray(at - np.tensordot(self.motion[number], basis, 1) * ratio, np.float32)


def find_scene(samples: LayerSamples) -> SceneLayer:
    """The scene of a sample, at rest or moving."""
    still = scene_picture(samples)
    motion = scene_motion(samples, still)
    return SceneLayer(still if motion is None else scene_picture(samples, motion), motion)


def scene_picture(samples: LayerSamples, motion: Array | None = None) -> Single:
    """(h, w, 3) BGR the scene; what the person always hides is filled in smoothly.

    motion: (n, 4) of the scene in each frame, see `scene_motion`; None: it stands still, and
        pictures in which nobody is there count, too.
    """
    shape = samples.pictures.shape[1:3]
    weights = np.maximum(1 - samples.mattes_at(shape) / CLEAR_MATTE, 0)
    pictures = samples.pictures
    if motion is not None:
        pictures = np.array(list(map(_moved_back, pictures, motion)))
        weights = np.array(list(map(_moved_back, weights, motion)))
    elif len(samples.empty):
        pictures = np.concatenate([pictures, samples.empty])
        weights = np.concatenate([weights, np.ones(samples.empty.shape[:3], np.float32)])
    mean = robust_mean(pictures, weights)
    return pull_push_fill(mean, weights.sum(0) > MIN_FRAMES)


def scene_motion(samples: LayerSamples, still: Single) -> Array | None:
    """(n, 4) how the scene moves in each frame; None if it stands still.

    still: the picture of the scene as if it did.
    """
    lumas = [coarse_luma(picture) for picture in samples.pictures]
    shape = lumas[0].shape[0], lumas[0].shape[1]
    clear = (samples.mattes_at(shape) < CLEAR_MATTE).astype(np.float32)
    at_rest = luma_at(still, shape)
    # The mean of moving pictures is blurred.
    first = clear[samples.canonical]
    scene = first * lumas[samples.canonical] + (1 - first) * at_rest
    motion = _fitted(scene, lumas, clear)
    motion = _fitted(luma_at(scene_picture(samples, motion), shape), lumas, clear)
    motion -= motion[samples.canonical]
    scene, basis = luma_at(scene_picture(samples, motion), shape), scene_basis(shape)
    moved = [sample(scene, scene_origins(basis, own)) for own in motion]
    left, before = (
        sum(map(left_of, lumas, drawn, clear)) for drawn in (moved, [at_rest] * len(lumas))
    )
    return motion if is_explained(left, before) else None


def _fitted(scene: Single, lumas: Iterable[Single], weights: Iterable[Single]) -> Array:
    each = zip(lumas, weights, strict=True)
    return np.array([fit_scene_motion(scene, luma, weight) for luma, weight in each])


def _moved_back(image: NDArray[Any], motion: Array) -> NDArray[Any]:
    """An image of a frame as the scene has it; 0 beyond the frame."""
    height, width = image.shape[:2]
    corners = np.array([[0.0, 0.0], [width - 1, 0], [0, height - 1]])
    away = np.tensordot(motion, displacement_basis(width, height, corners), 1)
    ends = (corners - away).astype(np.float32), corners.astype(np.float32)
    matrix = cv2.getAffineTransform(ends[1], ends[0])
    return np.asarray(cv2.warpAffine(image, matrix, (width, height), flags=cv2.INTER_LINEAR))
