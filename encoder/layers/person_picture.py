"""The picture of the person and their mask, from all frames, moved to the canonical one.

What the face covers is filled in smoothly: the decoder draws the face over it.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import dense, pixel_grid, sample
from encoder.layers.layer_samples import LayerSamples, face_region
from encoder.layers.robust_mean import MIN_FRAMES, robust_mean
from protocol.pictures.foreground_mask import MASK_SIDE, Mask
from shared_model.appearance import pull_push_fill

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The share of the aligned frames' mattes from which on a cell of the mask is the person.
PERSON_SHARE = 0.5
# Matte below which a pixel of an aligned frame does not show the person.
MIN_MATTE = 0.6
# So many cells around the mask the picture is not filled in: it is drawn softly there.
EDGE_CELLS = 2
# The face is filled in up to this share of its width from its outline.
FACE_MARGIN = 0.1


def aligned(images: NDArray[Any], samples: LayerSamples, motions: Sequence[Array]) -> Single:
    """Images (n, h, w) or (n, h, w, c) of the frames, moved to the canonical one.

    motions: (rows, columns, 2) source pixels, of the mesh in each frame.
    """
    shape = images.shape[1:3]
    grid = pixel_grid((shape[0], shape[1]))
    return np.array(
        [
            sample(image, grid + dense(motion, samples.size, (shape[0], shape[1])))
            for image, motion in zip(images, motions, strict=True)
        ]
    )


def person_mask(samples: LayerSamples, motions: Sequence[Array]) -> Mask:
    """(MASK_SIDE, MASK_SIDE) where the person is in the canonical picture.  See `aligned`."""
    mattes = aligned(samples.mattes_at((MASK_SIDE, MASK_SIDE)), samples, motions)
    return np.asarray(np.median(mattes, 0) > PERSON_SHARE)


def person_picture(samples: LayerSamples, motions: Sequence[Array], mask: Mask) -> Single:
    """(h, w, 3) BGR the person in the canonical picture, filled in around them and in the face."""
    shape = samples.pictures.shape[1:3]
    mattes = aligned(samples.mattes_at(shape), samples, motions)
    weights = np.clip((mattes - MIN_MATTE) / (1 - MIN_MATTE), 0, 1).astype(np.float32)
    weights[samples.canonical] += 1e-3
    mean = robust_mean(aligned(samples.pictures, samples, motions), weights)
    known = (weights.sum(0) > MIN_FRAMES) & drawn_region(mask, shape)
    return pull_push_fill(mean, known & ~covered_region(samples, shape))


def drawn_region(mask: Mask, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) where the decoder draws the person, if only softly."""
    kernel = np.ones((2 * EDGE_CELLS + 1,) * 2, np.uint8)
    wide = cv2.dilate(mask.astype(np.uint8), kernel)
    return np.asarray(cv2.resize(wide, shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)


def covered_region(samples: LayerSamples, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) what the face covers in the canonical picture, whatever its expression."""
    outline = samples.outlines_px[samples.canonical]
    inside = face_region(outline, samples.size, shape).astype(np.uint8)
    width = float(np.ptp(outline[:, 0])) * shape[1] / samples.size[0]
    reach = max(1, round(FACE_MARGIN * width))
    return np.asarray(cv2.erode(inside, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0)
