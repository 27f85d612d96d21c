"""Hats, helmets and other things on a head that the segmentation network takes for the scene.

What the motion of the head explains much better than the scene does, and what adjoins the person,
is the person's.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import dense, origins, sample
from encoder.layers.layer_samples import LayerSamples, aligned
from encoder.layers.person_picture import (
    PERSON_SHARE,
    REACH_CELLS,
    TRUST_GREY2,
    layer_errors,
    whole,
)
from encoder.layers.scene import SceneLayer
from protocol.pictures.foreground_mask import FINE_MASK_SIDE, Mask

Single = NDArray[np.float32]

# The greatest error of the person, of that of the scene, at which a cell moves with the head.
MAX_ERROR_RATIO = 0.5
# The least number of cells farther from the network's person than their outline is refined.
MIN_FAR_CELLS = 100
# Thinner parts are edges of the scene, cells; smaller holes in what adjoins the person are filled.
MIN_WIDTH_CELLS, MAX_HOLE_CELLS = 5, 150


def with_headwear(samples: LayerSamples, scene: SceneLayer) -> LayerSamples:
    """The sample with what moves with the head in its mattes; the same sample if that is nothing.

    scene: of the sample.
    """
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    motions = list(samples.motion)
    share = np.median(aligned(samples.mattes_at(shape), samples, motions), 0)
    person = np.asarray(share > PERSON_SHARE)
    found = headwear(person, *layer_errors(samples, motions, scene))
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


def headwear(person: Mask, of_scene: Single, of_person: Single) -> Mask:
    """(n, n) what belongs to a person (n, n), but is not in it.

    of_scene, of_person: see `layer_errors`.
    """
    moving = (of_scene - of_person > TRUST_GREY2) & (of_person < MAX_ERROR_RATIO * of_scene)
    thin = np.ones((MIN_WIDTH_CELLS,) * 2, np.uint8)
    wide = cv2.morphologyEx((moving | person).astype(np.uint8), cv2.MORPH_OPEN, thin) > 0
    more = whole(np.asarray(wide | person), MAX_HOLE_CELLS) & ~person
    near = cv2.dilate(person.astype(np.uint8), np.ones((2 * REACH_CELLS + 1,) * 2, np.uint8)) > 0
    _, parts = cv2.connectedComponents(more.astype(np.uint8))
    far_cells = np.bincount(parts[more & ~near], minlength=parts.max() + 1)
    return np.isin(parts, np.flatnonzero(far_cells >= MIN_FAR_CELLS)) & more
