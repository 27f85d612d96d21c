"""The picture of the person and their mask, from all frames, moved to the canonical one.

The segmentation network tells the mask roughly.  Near its outline a cell belongs to the layer that
explains the frames better.  A hat that the network takes for the scene is the person's if it
adjoins them and the motion of the head explains it much better.  What the face covers is filled in
smoothly: the decoder draws the face over it.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import dense, origins, pixel_grid, sample
from encoder.layers.layer_samples import MIN_FRAMES, LayerSamples, aligned, face_region
from encoder.layers.scene import SceneLayer
from encoder.layers.scene_motion import blurred
from encoder.runtime.robust_mean import robust_mean
from protocol.pictures.foreground_mask import FINE_MASK_SIDE, Mask
from shared_model.appearance import pull_push_fill
from shared_model.layers.soft_mask import opacity

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The share of the aligned frames' mattes from which on a cell is the person.
PERSON_SHARE = 0.5
# How far from its outline the mask is refined, cells.
REACH_CELLS = 8
# The mean difference of squared errors, squared grey levels, that outweighs the network where it is
# sure; a pixel's squared error counts at most so much.
TRUST_GREY2, MAX_GREY2 = 60.0, 900.0
# Standard deviation of the kernel that smooths the errors, cells; holes of so many are filled.
SIGMA_CELLS, MAX_HOLE_CELLS = 1.2, 11
# Matte below which a pixel of an aligned frame does not show the person.
MIN_MATTE = 0.6
# The least weight of a pixel in the mask.
MIN_WEIGHT = 0.3
# So many cells around the mask the picture is not filled in: it is drawn softly there.
EDGE_CELLS = 4
# Where the person is drawn at least so softly, their picture is the one that gives the mean of the
# frames together with the scene; fully from the second on.
SOFT_OPACITY = 0.2, 0.3
# The face is filled in up to this share of its width from its outline.
FACE_MARGIN = 0.1
# The greatest error of the person, of that of the scene, at which a cell moves with the head.
HEADWEAR_ERROR_RATIO = 0.5
# The least number of cells farther from the network's person than their outline is refined.
HEADWEAR_FAR_CELLS = 100
# Thinner parts are edges of the scene, cells; smaller holes in what adjoins the person are filled.
HEADWEAR_WIDTH_CELLS, HEADWEAR_HOLE_CELLS = 5, 150


def with_headwear(samples: LayerSamples, scene: SceneLayer) -> LayerSamples:
    """The sample with what moves with the head in its mattes; the same sample if that is nothing.

    scene: of the sample.
    """
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    motions = list(samples.motion)
    share = np.median(aligned(samples.mattes_at(shape), samples, motions), 0)
    person = np.asarray(share > PERSON_SHARE)
    found = _headwear(person, *_layer_errors(samples, motions, scene))
    if not found.any():
        return samples
    side = samples.mattes.shape[1], samples.mattes.shape[2]
    resized = cv2.resize(found.astype(np.float32), side[::-1], interpolation=cv2.INTER_AREA)
    small = np.asarray(resized, np.float32)
    mattes = [
        np.maximum(matte, sample(small, origins(dense(motion, samples.size, side))))
        for matte, motion in zip(samples.mattes, motions, strict=True)
    ]
    return replace(samples, mattes=np.array(mattes))


def person_mask(
    samples: LayerSamples, motions: Sequence[Array], scene: SceneLayer, margin: float = 0.0
) -> Mask:
    """(FINE_MASK_SIDE, FINE_MASK_SIDE) where the person is in the canonical picture.

    motions: see `aligned`.  margin: how much better than the scene the person must explain a cell
    near the outline, in `TRUST_GREY2`: the greater, the narrower is the mask.
    """
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    share = np.median(aligned(samples.mattes_at(shape), samples, motions), 0)
    likely = share > PERSON_SHARE
    of_scene, of_person = _layer_errors(samples, motions, scene)
    smooth = of_scene - of_person
    kernel = np.ones((2 * REACH_CELLS + 1,) * 2, np.uint8)
    near = cv2.dilate(likely.astype(np.uint8), kernel) > cv2.erode(likely.astype(np.uint8), kernel)
    score = smooth / TRUST_GREY2 + 2 * share - 1
    return _whole(np.where(near, score > margin, likely))


def person_picture(
    samples: LayerSamples, motions: Sequence[Array], mask: Mask, scene: SceneLayer
) -> Single:
    """(h, w, 3) BGR the person in the canonical picture, filled in around them and in the face.

    motions: see `aligned`.
    """
    shape = samples.pictures.shape[1], samples.pictures.shape[2]
    mattes = aligned(samples.mattes_at(shape), samples, motions)
    weights = np.clip((mattes - MIN_MATTE) / (1 - MIN_MATTE), 0, 1).astype(np.float32)
    inside = cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    weights = np.maximum(weights, np.float32(MIN_WEIGHT) * inside)
    weights[samples.canonical] += 1e-3
    frames = aligned(samples.pictures, samples, motions)
    mean = robust_mean(frames, weights, samples.workers)
    known = (weights.sum(0) > MIN_FRAMES) & drawn_region(mask, shape)
    alpha = opacity(mask, shape[1], shape[0]).astype(np.float32)
    soft = (alpha > SOFT_OPACITY[0]) & (alpha < 1)
    share = soft * np.clip((alpha - SOFT_OPACITY[0]) / np.ptp(SOFT_OPACITY), 0, 1)
    mean += share[..., None] * (_unmixed(frames, alpha, samples, motions, scene) - mean)
    covered = covered_region(samples.outlines_px[samples.canonical], samples.size, shape)
    return pull_push_fill(mean, (known | soft) & ~covered)


def _unmixed(
    frames: Single,
    alpha: Single,
    samples: LayerSamples,
    motions: Sequence[Array],
    scene: SceneLayer,
) -> Single:
    """(h, w, 3) what gives the mean of the frames if it is drawn over the scene.

    frames: (n, h, w, 3) aligned; they are overwritten.  alpha: (h, w) the opacity it is drawn with.
    """
    shape, clear = alpha.shape, 1 - alpha[..., None]
    for number, (frame, motion) in enumerate(zip(frames, motions, strict=True)):
        at = pixel_grid(shape) + dense(motion, samples.size, shape)
        frame -= clear * sample(scene.picture, scene.origins(number, at, samples.size))
    mean = robust_mean(frames, np.ones(frames.shape[:3], np.float32), samples.workers)
    return np.clip(mean / np.maximum(alpha, SOFT_OPACITY[0])[..., None], 0, 255)


def drawn_region(mask: Mask, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) where the decoder draws the person, if only softly."""
    kernel = np.ones((2 * EDGE_CELLS + 1,) * 2, np.uint8)
    wide = cv2.dilate(mask.astype(np.uint8), kernel)
    return np.asarray(cv2.resize(wide, shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)


def covered_region(
    outline_px: Array, size: tuple[int, int], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """(h, w) what the face covers in a picture, whatever its expression.  See `face_region`."""
    inside = face_region(outline_px, size, shape).astype(np.uint8)
    width = float(np.ptp(outline_px[:, 0])) * shape[1] / size[0]
    reach = max(1, round(FACE_MARGIN * width))
    return np.asarray(cv2.erode(inside, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0)


def _headwear(person: Mask, of_scene: Single, of_person: Single) -> Mask:
    """(n, n) what belongs to a person (n, n), but is not in it.

    of_scene, of_person: see `_layer_errors`.
    """
    moving = (of_scene - of_person > TRUST_GREY2) & (of_person < HEADWEAR_ERROR_RATIO * of_scene)
    thin = np.ones((HEADWEAR_WIDTH_CELLS,) * 2, np.uint8)
    wide = cv2.morphologyEx((moving | person).astype(np.uint8), cv2.MORPH_OPEN, thin) > 0
    more = _whole(np.asarray(wide | person), HEADWEAR_HOLE_CELLS) & ~person
    near = cv2.dilate(person.astype(np.uint8), np.ones((2 * REACH_CELLS + 1,) * 2, np.uint8)) > 0
    _, parts = cv2.connectedComponents(more.astype(np.uint8))
    far_cells = np.bincount(parts[more & ~near], minlength=parts.max() + 1)
    return np.isin(parts, np.flatnonzero(far_cells >= HEADWEAR_FAR_CELLS)) & more


def _layer_errors(
    samples: LayerSamples, motions: Sequence[Array], scene: SceneLayer
) -> tuple[Single, Single]:
    """(n, n) mean squared errors of the scene and of the person, smoothed, squared grey levels.

    n: FINE_MASK_SIDE, in the canonical picture.  motions: see `aligned`.
    """
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    small = np.array([_resized(picture) for picture in samples.pictures])
    frames = aligned(small, samples, motions)
    person = robust_mean(frames, np.ones(frames.shape[:3], np.float32), samples.workers)
    behind, total = _resized(scene.picture), np.zeros((2, *shape), np.float32)
    for number, (frame, motion) in enumerate(zip(frames, motions, strict=True)):
        at = pixel_grid(shape) + dense(motion, samples.size, shape)
        seen = sample(behind, scene.origins(number, at, samples.size))
        for layer, drawn in enumerate((seen, person)):
            total[layer] += np.minimum(((frame - drawn) ** 2).mean(-1), MAX_GREY2)
    of_scene, of_person = total / len(frames)
    return blurred(of_scene, SIGMA_CELLS), blurred(of_person, SIGMA_CELLS)


def _resized(picture: NDArray[np.generic]) -> Single:
    """(n, n, 3) a picture (h, w, 3) at the size of the mask."""
    size = FINE_MASK_SIDE, FINE_MASK_SIDE
    small = cv2.resize(np.asarray(picture, np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def _whole(mask: Mask, max_hole_cells: int = MAX_HOLE_CELLS) -> Mask:
    """The largest part of a mask, holes of up to `max_hole_cells` filled."""
    if not mask.any():
        return mask
    _, parts = cv2.connectedComponents(mask.astype(np.uint8))
    person = parts == np.bincount(parts[mask]).argmax()
    _, holes = cv2.connectedComponents((~person).astype(np.uint8))
    small = np.flatnonzero(np.bincount(holes.ravel()) <= max_hole_cells)
    return np.asarray(person | np.isin(holes, small))
