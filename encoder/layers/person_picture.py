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

from encoder.layers.displacement import dense, origins, pixel_grid, sample
from encoder.layers.layer_samples import (
    MIN_FRAMES,
    LayerSamples,
    face_region,
    mask_sized,
    positions,
    sampled,
)
from encoder.layers.scene import SceneLayer
from protocol.pictures.foreground_mask import FINE_MASK_SIDE
from runtime.image_ops import blurred
from runtime.jit import jit
from runtime.parallel import available_cores, parallel_map
from runtime.robust_mean import robust_mean
from shared_model.appearance import pull_push_fill
from shared_model.arrays import Array, Indices, Mask, Single
from shared_model.layers.soft_mask import opacity

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
# The weight of what a frame would show beyond its edge.
BEYOND_WEIGHT = 1e-3
# The least weight of a pixel in the mask.
MIN_WEIGHT = 0.3
# So many cells around the mask the picture is not filled in: it is drawn softly there.
EDGE_CELLS = 4
# Where the person is drawn at least so softly, their picture is the one that gives the mean of the
# frames together with the scene; fully from the second on.
SOFT_OPACITY = 0.2, 0.3
# Pixels that are sampled are taken in rows of so many.
PIXELS_A_ROW = 256
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
    at = positions(samples, motions, shape)
    share = _share(samples, at, shape)
    person = np.asarray(share > PERSON_SHARE)
    found = _headwear(person, *_layer_errors(samples, at, scene))
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

    motions: see `positions`.  margin: how much better than the scene the person must explain a cell
    near the outline, in `TRUST_GREY2`: the greater, the narrower is the mask.
    """
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    at = positions(samples, motions, shape)
    share = _share(samples, at, shape)
    likely = share > PERSON_SHARE
    of_scene, of_person = _layer_errors(samples, at, scene)
    smooth = of_scene - of_person
    kernel = np.ones((2 * REACH_CELLS + 1,) * 2, np.uint8)
    near = cv2.dilate(likely.astype(np.uint8), kernel) > cv2.erode(likely.astype(np.uint8), kernel)
    score = smooth / TRUST_GREY2 + 2 * share - 1
    return _whole(np.where(near, score > margin, likely))


def _share(samples: LayerSamples, at: Single, shape: tuple[int, int]) -> Single:
    """(h, w) the median of the mattes at positions (n, h, w, 2), of the frames that reach so far.

    Where none does, that of what they have at their edges.
    """
    mattes = sampled(samples.mattes_at(shape), at, samples.workers)
    beyond = _within(at, shape) < 1
    some = beyond.any(0) & ~beyond.all(0)

    def median(part: tuple[Single, Mask, Mask]) -> Single:
        values, is_beyond, is_some = part
        middle = np.median(values, 0)
        known = np.where(is_beyond[:, is_some], np.nan, values[:, is_some])
        middle[is_some] = np.nanmedian(known, 0)
        return np.asarray(middle, np.float32)

    count = samples.workers or available_cores()
    split = np.array_split(mattes, count, 1), np.array_split(beyond, count, 1)
    parts = zip(*split, np.array_split(some, count), strict=True)
    return np.concatenate(parallel_map(median, parts, samples.workers))


def _within(at: Single, shape: tuple[int, int]) -> Single:
    """(n, h', w') the weight of positions (n, h', w', 2) in frames (h, w): 1, or beyond them
    `BEYOND_WEIGHT`, since a frame shows only what is in it.
    """
    height, width = shape
    x, y = at[..., 0], at[..., 1]
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
    return np.where(inside, np.float32(1), np.float32(BEYOND_WEIGHT))


def person_picture(
    samples: LayerSamples, motions: Sequence[Array], mask: Mask, scene: SceneLayer
) -> Single:
    """(h, w, 3) BGR the person in the canonical picture, filled in around them and in the face.

    motions: see `positions`.
    """
    shape = samples.pictures.shape[1], samples.pictures.shape[2]
    alpha = opacity(mask, shape[1], shape[0]).astype(np.float32)
    drawn, soft = drawn_region(mask, shape), (alpha > SOFT_OPACITY[0]) & (alpha < 1)
    covered = covered_region(samples.outlines_px[samples.canonical], samples.size, shape)
    picture, known = np.zeros((*shape, 3), np.float32), np.zeros(shape, bool)
    used = (drawn | soft) & ~covered
    if not used.any():
        return picture
    pixels = _in_rows(np.flatnonzero(used))
    at, weights = _shown(samples, motions, mask, pixels)
    frames = sampled(samples.pictures, at, samples.workers)
    mean = robust_mean(frames, weights, samples.workers)
    shown = (weights.sum(0) > MIN_FRAMES) & drawn.ravel()[pixels]
    alpha, soft = alpha.ravel()[pixels], soft.ravel()[pixels]
    if soft.any():
        rows = _in_rows(np.flatnonzero(soft))
        opaque = alpha.ravel()[rows]
        share = np.clip((opaque - SOFT_OPACITY[0]) / np.ptp(SOFT_OPACITY), 0, 1)[..., None]
        there = at.reshape(len(at), -1, 2)[:, rows]
        own = frames.reshape(len(at), -1, 3)[:, rows]
        mixed, flat = mean.reshape(-1, 3)[rows], mean.reshape(-1, 3)
        mixed += share * (_unmixed(own, there, opaque, samples, scene) - mixed)
        flat[rows] = mixed
    picture.reshape(-1, 3)[pixels], known.ravel()[pixels] = mean, shown | soft
    return pull_push_fill(picture, known)


def _in_rows(numbers: Indices) -> Indices:
    """(r, PIXELS_A_ROW) numbers (m,), the last one repeated."""
    missing = -len(numbers) % PIXELS_A_ROW
    return np.pad(numbers, (0, missing), mode="edge").reshape(-1, PIXELS_A_ROW)


def _shown(
    samples: LayerSamples, motions: Sequence[Array], mask: Mask, pixels: Indices
) -> tuple[Single, Single]:
    """(n, h', w', 2) where pixels of the person's picture are in the frames; (n, h', w') weights.

    motions: see `positions`.  pixels: (h', w') row-major numbers.
    """
    shape = samples.pictures.shape[1], samples.pictures.shape[2]
    inside = cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0

    def shown(number: int) -> tuple[Single, Single]:
        at = pixel_grid(shape) + dense(motions[number], samples.size, shape)
        matte = cv2.resize(samples.mattes[number], shape[::-1], interpolation=cv2.INTER_LINEAR)
        clear = sample(matte, at).ravel()[pixels]
        weight = np.clip((clear - MIN_MATTE) / (1 - MIN_MATTE), 0, 1).astype(np.float32)
        weight = np.maximum(weight, np.float32(MIN_WEIGHT) * inside.ravel()[pixels])
        there = at.reshape(-1, 2)[pixels]
        return there, weight * _within(there, shape)

    each = parallel_map(shown, range(len(motions)), samples.workers)
    at, weights = (np.array(parts) for parts in zip(*each, strict=True))
    weights[samples.canonical] += 1e-3
    return at, weights


def _unmixed(
    frames: Single, at: Single, alpha: Single, samples: LayerSamples, scene: SceneLayer
) -> Single:
    """(h', w', 3) what gives the mean of the frames if it is drawn over the scene.

    frames: (n, h', w', 3) what they have there; it is overwritten.  at: (n, h', w', 2) where that
    is.  alpha: (h', w') the opacity it is drawn with.
    """
    shape = samples.pictures.shape[1], samples.pictures.shape[2]
    clear = 1 - alpha[..., None]

    def take_scene(number: int) -> None:
        behind = scene.origins(number, at[number], shape, samples.size)
        frames[number] -= clear * sample(scene.picture, behind)

    parallel_map(take_scene, range(len(frames)), samples.workers)
    mean = robust_mean(frames, _within(at, shape), samples.workers)
    return np.clip(mean / np.maximum(alpha, SOFT_OPACITY[0])[..., None], 0, 255)


def drawn_region(mask: Mask, shape: tuple[int, int]) -> Mask:
    """(h, w) where the decoder draws the person, if only softly."""
    kernel = np.ones((2 * EDGE_CELLS + 1,) * 2, np.uint8)
    wide = cv2.dilate(mask.astype(np.uint8), kernel)
    return np.asarray(cv2.resize(wide, shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)


def covered_region(outline_px: Array, size: tuple[int, int], shape: tuple[int, int]) -> Mask:
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


def _layer_errors(samples: LayerSamples, at: Single, scene: SceneLayer) -> tuple[Single, Single]:
    """(n, n) mean squared errors of the scene and of the person, smoothed, squared grey levels.

    n: FINE_MASK_SIDE, in the canonical picture.  at: its `positions`.
    """
    frames = sampled(samples.small_pictures(), at, samples.workers)
    behind, shape = mask_sized(scene.picture), (FINE_MASK_SIDE, FINE_MASK_SIDE)
    weights = _within(at, shape)
    person = robust_mean(frames, weights, samples.workers)

    def errors(number: int) -> Single:
        seen = sample(behind, scene.origins(number, at[number], shape, samples.size))
        return np.asarray(weights[number] * squared_errors(frames[number], seen, person))

    total = np.zeros((2, *shape), np.float32)
    for each in parallel_map(errors, range(len(frames)), samples.workers):
        total += each
    of_scene, of_person = total / weights.sum(0)
    return blurred(of_scene, SIGMA_CELLS), blurred(of_person, SIGMA_CELLS)


@jit
def squared_errors(frame: Single, first: Single, second: Single) -> Single:
    """(2, h, w) mean squared errors of two pictures of a frame, (h, w, 3) all, up to MAX_GREY2."""
    errors = np.empty((2, *frame.shape[:2]), np.float32)
    for layer in range(2):
        picture = second if layer else first
        for row in range(frame.shape[0]):
            for column in range(frame.shape[1]):
                blue = frame[row, column, 0] - picture[row, column, 0]
                green = frame[row, column, 1] - picture[row, column, 1]
                red = frame[row, column, 2] - picture[row, column, 2]
                mean = (blue * blue + green * green + red * red) / np.float32(3)
                errors[layer, row, column] = min(mean, np.float32(MAX_GREY2))
    return errors


def _whole(mask: Mask, max_hole_cells: int = MAX_HOLE_CELLS) -> Mask:
    """The largest part of a mask, holes of up to `max_hole_cells` filled."""
    if not mask.any():
        return mask
    _, parts = cv2.connectedComponents(mask.astype(np.uint8))
    person = parts == np.bincount(parts[mask]).argmax()
    _, holes = cv2.connectedComponents((~person).astype(np.uint8))
    small = np.flatnonzero(np.bincount(holes.ravel()) <= max_hole_cells)
    return np.asarray(person | np.isin(holes, small))
