"""The picture of the scene: what stands behind the person, from all frames of a sample.

Where the camera moves, the frames are moved back first: their motion is found by fitting a picture
of the scene to them.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import sample
from encoder.layers.layer_samples import MIN_FRAMES, CoarseFrame, LayerSamples, luma_at
from encoder.layers.scene_motion import (
    fit_scene_motion,
    is_explained,
    residual_energy,
    scene_basis,
    scene_origins,
    scene_pyramid,
)
from runtime.jit import jit
from runtime.parallel import parallel_map
from runtime.robust_mean import robust_mean
from shared_model.appearance import pull_push_fill
from shared_model.arrays import Array, Single
from shared_model.layers.scene_motion import displacement_basis

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

    def origins(
        self, number: int, at: Single, shape: tuple[int, int], size: tuple[int, int]
    ) -> Single:
        """Where positions in frame `number` come from in the picture of the scene.

        at: (..., 2) pixels of a picture of `shape`.  size: of the source, (width, height).
        """
        if self.motion is None:
            return at
        # The displacement is linear: that of three points tells that of all.
        ratio = np.array(shape[::-1]) / np.array(size)
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        basis = displacement_basis(*size, (corners + 0.5) / ratio - 0.5)
        still, right, down = np.tensordot(self.motion[number], basis, 1) * ratio
        return _moved_by(at.reshape(-1, 2), still, right - still, down - still).reshape(at.shape)


@jit
def _moved_by(at: Single, still: Array, right: Array, down: Array) -> Single:
    """Positions (m, 2) less a displacement: that of (0, 0), its growth to the right and down."""
    moved = np.empty_like(at)
    for number in range(len(at)):
        x, y = at[number]
        for axis in range(2):
            away = still[axis] + x * right[axis] + y * down[axis]
            moved[number, axis] = at[number, axis] - away
    return moved


def find_scene(samples: LayerSamples) -> SceneLayer:
    """The scene of a sample, at rest or moving."""
    still = scene_picture(samples)
    motion = _scene_motion(samples, still)
    moving = SceneLayer(scene_picture(samples, motion), motion)
    return moving if _moves(samples, moving, still) else SceneLayer(still, None)


def scene_picture(samples: LayerSamples, motion: Array | None = None) -> Single:
    """(h, w, 3) BGR the scene; what the person always hides is filled in smoothly.

    motion: (n, 4) of the scene in each frame, see `scene_motion`; None: it stands still, and
        pictures in which nobody is there count, too.
    """
    shape = samples.pictures.shape[1:3]
    weights = np.maximum(1 - samples.mattes_at(shape) / CLEAR_MATTE, 0)
    pictures = samples.pictures
    if motion is not None:
        pictures = _moved_back(pictures, motion, samples.workers)
        weights = _moved_back(weights, motion, samples.workers)
    elif len(samples.empty):
        pictures = np.concatenate([pictures, samples.empty])
        weights = np.concatenate([weights, np.ones(samples.empty.shape[:3], np.float32)])
    mean = robust_mean(pictures, weights, samples.workers)
    return pull_push_fill(mean, weights.sum(0) > MIN_FRAMES)


def _scene_motion(samples: LayerSamples, still: Single) -> Array:
    """(n, 4) how the scene moves in each frame, if it does.

    still: the picture of the scene as if it did not.
    """
    frames, weights = samples.coarse_frames(), _clear(samples)
    shape = weights.shape[1], weights.shape[2]
    # The mean of moving pictures is blurred.
    first = weights[samples.canonical]
    luma = frames[samples.canonical].luma
    scene = first * luma + (1 - first) * luma_at(still, shape)
    motion = _fitted(scene, samples, weights)
    motion = _fitted(luma_at(scene_picture(samples, motion), shape), samples, weights)
    return np.asarray(motion - motion[samples.canonical])


def _moves(samples: LayerSamples, scene: SceneLayer, still: Single) -> bool:
    """Whether a scene that moves explains a sample better than one that stands still."""
    assert scene.motion is not None
    frames, weights = samples.coarse_frames(), _clear(samples)
    shape = weights.shape[1], weights.shape[2]
    picture, basis, at_rest = (
        luma_at(scene.picture, shape),
        scene_basis(shape),
        luma_at(still, shape),
    )
    moved = [sample(picture, scene_origins(basis, own)) for own in scene.motion]
    left, before = (
        sum(
            residual_energy(frame.luma, *each)
            for frame, *each in zip(frames, drawn, weights, strict=True)
        )
        for drawn in (moved, [at_rest] * len(frames))
    )
    return is_explained(left, before)


def _clear(samples: LayerSamples) -> Single:
    """(n, h, w) 1 where a frame shows the scene, else 0; at the coarse size."""
    shape = samples.coarse_frames()[0].luma.shape
    return (samples.mattes_at((shape[0], shape[1])) < CLEAR_MATTE).astype(np.float32)


def _fitted(scene: Single, samples: LayerSamples, weights: Single) -> Array:
    """(n, 4) the motion of a scene (h, w) in each frame.  weights: (n, h, w) of the frames."""
    pyramid = scene_pyramid(scene)
    frames = list(zip(samples.coarse_frames(), weights, strict=True))

    def fit(frame: tuple[CoarseFrame, Single]) -> Array:
        return fit_scene_motion(pyramid, frame[0].luma, frame[1])

    return np.array(parallel_map(fit, frames, samples.workers))


def _moved_back(images: NDArray[Any], motion: Array, workers: int | None) -> NDArray[Any]:
    """Images (n, ...) of the frames as the scene has them; 0 beyond the frame."""
    height, width = images.shape[1:3]
    corners = np.array([[0.0, 0.0], [width - 1, 0], [0, height - 1]])
    basis, moved = displacement_basis(width, height, corners), np.empty_like(images)

    def move(number: int) -> None:
        away = np.tensordot(motion[number], basis, 1)
        ends = (corners - away).astype(np.float32), corners.astype(np.float32)
        matrix = cv2.getAffineTransform(ends[1], ends[0])
        size, flags = (width, height), cv2.INTER_LINEAR
        moved[number] = cv2.warpAffine(images[number], matrix, size, flags=flags)

    parallel_map(move, range(len(images)), workers)
    return moved
