"""What is behind the face, decoded.

A layered background has a picture of the person, who moves, and one of the scene.  Of one picture
with a mask both are made here; one picture without is drawn as if all of it were the person.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from decoder.scene.appearance import decode_image
from protocol.pictures.foreground_mask import parse_background
from protocol.pictures.layered_background import (
    FIELD_CODES_PER_PX,
    decode_changes,
    is_layered,
    parse_layers,
)
from shared_model.appearance import pull_push_fill
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.layers.soft_mask import opacity

# Feathering of the mask, in its cells, and the range of the feathered mask over which alpha rises
# from 0 to 1.  It starts low: hair outside the mask moves with the head.
FEATHER_SIGMA = 1.5
ALPHA_RANGE = 0.02, 0.3


@dataclass(frozen=True, slots=True)
class BackgroundLayers:
    """The layers behind the face.

    moving: (h, w, 3) uint8 BGR, or (h, w, 4) with alpha: moves with the head.
    static: (h, w, 3) uint8 BGR: stands still behind it; None if `moving` is opaque.
    fields_px: (k, rows, columns, 2) motion fields of `moving`, see `shared_model.layers`.
    changes: (c, rows, columns, 3) BGR, what a unit of each further coefficient adds to both.
    scene_moves: whether coefficients after these move `static`, see `shared_model.layers`.
    light_changes: whether the last coefficients change the light on both.
    """

    moving: Picture
    static: Picture | None = None
    fields_px: Array | None = None
    changes: Single | None = None
    scene_moves: bool = False
    light_changes: bool = False


def load_background(background: bytes, width: int, height: int) -> BackgroundLayers:
    """The layers of a model packet's background; black if it is empty.

    width, height: of the source picture.
    Raises `ProtocolError` if the background is damaged or too large.
    """
    if not background:
        return BackgroundLayers(np.zeros((2, 2, 3), np.uint8))
    if is_layered(background):
        return _load_layers(background, width, height)
    mask, data = parse_background(background)
    picture = decode_image("background", data)
    if mask is None:
        return BackgroundLayers(picture)
    feathered = _feathered(mask, picture.shape[1], picture.shape[0])
    low, high = ALPHA_RANGE
    alpha = np.rint(255 * np.clip((feathered - low) / (high - low), 0, 1)).astype(np.uint8)
    static = np.rint(pull_push_fill(picture.astype(np.float32), feathered <= low))
    return BackgroundLayers(np.dstack([picture, alpha]), static.astype(np.uint8))


def _load_layers(background: bytes, width: int, height: int) -> BackgroundLayers:
    layers = parse_layers(background, width, height)
    person = decode_image("person", layers.person)
    alpha = np.rint(255 * opacity(layers.mask, person.shape[1], person.shape[0]))
    return BackgroundLayers(
        np.dstack([person, alpha.astype(np.uint8)]),
        decode_image("scene", layers.scene),
        layers.fields / FIELD_CODES_PER_PX,
        decode_changes(layers.changes, width, height),
        layers.scene_moves,
        layers.light_changes,
    )


def _feathered(mask: Mask, width: int, height: int) -> Single:
    """(height, width) the mask with a soft edge, 0..1."""
    blurred = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), FEATHER_SIGMA)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR))
