"""The test vector of a call with a layered background; see `make_vectors`."""

from dataclasses import replace
from typing import Any

import numpy as np

from encoder.picture_coding.picture_encoder import encode_mode, encode_picture
from protocol.frames.frame_transform import GEOMETRY_SIZE, FrameTransform
from protocol.model_packet import ModelPacket
from protocol.pictures.foreground_mask import MASK_SIDE
from protocol.pictures.layered_background import (
    MAX_FIELD_CODE,
    LayeredBackground,
    change_codec,
    change_shape,
    decode_changes,
    field_shape,
    parse_layers,
    serialise_layers,
)
from protocol.pictures.picture_codec import decode_picture, to_planes
from shared_model.arrays import Single

# Motion fields and changes.
FIELDS, CHANGES = 2, 2


def layered_background(width: int, height: int, pictures: tuple[Single, Single]) -> bytes:
    """A layered background of pictures (h, w, 3) BGR: the person and the scene."""
    y, x = np.mgrid[:MASK_SIDE, :MASK_SIDE] / MASK_SIDE - 0.5
    rows, columns = field_shape(width, height)
    rng = np.random.default_rng(9)
    fields = rng.integers(-9, 10, (FIELDS, rows, columns, 2)).cumsum(1).cumsum(2)
    codec, shape = change_codec(width, height), change_shape(width, height)
    down, across = np.mgrid[: shape[0], : shape[1]] / max(shape)
    waves = (np.stack([down, across, down + across], -1), np.sin(9 * down)[..., None] + [0, 0.5, 1])
    coded = [encode_mode(codec, to_planes((40 * each).astype(np.float32)), 20) for each in waves]
    person, scene = (encode_picture(picture, 30).serialise() for picture in pictures)
    return serialise_layers(
        LayeredBackground(
            mask=(x**2 / 0.04 + y**2 / 0.08 < 1) | (y > 0.3),
            person=person,
            scene=scene,
            fields=np.clip(fields, -MAX_FIELD_CODE, MAX_FIELD_CODE),
            changes=tuple(mode.serialise() for mode in coded),
        )
    )


def with_layers(transform: FrameTransform) -> FrameTransform:
    """A transform with coefficients of the layers, as large as those of modes."""
    rng, count = np.random.default_rng(10), FIELDS + CHANGES
    at = [GEOMETRY_SIZE] * count
    components = len(transform.basis)
    columns = rng.integers(-127, 128, (components, count)).astype(np.int8)
    return replace(
        transform,
        unit_codes=np.insert(transform.unit_codes, at, 118),
        mean_codes=np.insert(transform.mean_codes, at, rng.integers(-9, 10, count)),
        basis=np.insert(transform.basis, at, columns, axis=1),
        layers=count,
    )


def decoded_layers(model: ModelPacket) -> dict[str, Any]:
    """What a decoder finds in a layered background: all but the pictures' every row."""
    width, height = model.call.width, model.call.height
    layers = parse_layers(model.background, width, height)
    person, scene = (
        decode_picture(name, data)
        for name, data in (("person", layers.person), ("scene", layers.scene))
    )
    changes = decode_changes(layers.changes, width, height)
    middle = [each[len(each) // 2] for each in (person, scene, *changes)]
    return {
        "mask": ["".join("#" if cell else "." for cell in row) for row in layers.mask],
        "fields": layers.fields.tolist(),
        "person_and_scene_and_changes": [
            [[round(float(value), 3) for value in pixel] for pixel in row] for row in middle
        ],
    }
