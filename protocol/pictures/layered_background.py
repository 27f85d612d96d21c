"""The layered background of a model packet: the scene, the person before it, and how both change.

A layered background is the tag `L`, or `M` and a byte of flags, then its parts: the mask, the
picture of the person, the motion fields, the number of changes (one byte) and the changes, then the
picture of the scene.  Mask, picture, fields and each change follow after their length (varint).  A
background without layers is one picture.

The person moves with the head and, on top of it, along motion fields; both pictures change by
`changes`; the scene may move as a whole; the light on both may change.  A frame has a layer
coefficient for each field, then for each change, then for the motion of the scene, then for the
light.
"""

from dataclasses import dataclass

import numpy as np

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import BitCoder, RangeDecoder, RangeEncoder
from protocol.entropy.varint import FieldReader, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import MAX_IMAGE_BYTES
from protocol.pictures.foreground_mask import (
    FINE_MASK_SIDE,
    MASK_SIDE,
    MAX_MASK_BYTES,
    decode_mask,
    encode_mask,
    parse_background,
)
from protocol.pictures.picture_codec import ModeCodec
from shared_model.arrays import Integers, Mask, Single

TAG, FLAGGED_TAG = b"L", b"M"
# Of the motion of the scene, see `shared_model.layers.scene_motion`.
SCENE_COEFFICIENTS = 4
# Of the light, see `shared_model.layers.light`.
LIGHT_COEFFICIENTS = 2
# Flags: the scene moves; the mask is a fine one; the light changes.
_SCENE_MOVES, _FINE_MASK, _LIGHT_CHANGES = 1, 2, 4
MAX_FIELDS, MAX_CHANGES = 8, 8
MAX_FIELD_BYTES = 8192
MAX_FIELD_CODE = 127
# Codes of a field for a displacement of a pixel of the source picture per unit of its coefficient.
FIELD_CODES_PER_PX = 64
# Points of a motion field along the longer side of the picture.
FIELD_POINTS = 13
# Pixels of a change along the longer side of the picture.
CHANGE_SIDE = 96
# The step of a code is known from those of the codes before it, in three contexts.
_CONTEXTS = 3


@dataclass(frozen=True, slots=True)
class LayeredBackground:
    """The parts of a layered background.

    mask: (n, n) of the person in their picture; n is MASK_SIDE or FINE_MASK_SIDE.
    person, scene: encoded pictures.
    fields: (k, rows, columns, 2) codes -MAX_FIELD_CODE..MAX_FIELD_CODE: displacement in x and y at
        points evenly over the picture, corner to corner, see `field_shape`.
    changes: encoded modes of `change_shape`, added to both pictures.
    scene_moves: frames have coefficients of `shared_model.layers.scene_motion`.
    light_changes: frames have coefficients of `shared_model.layers.light`.
    """

    mask: Mask
    person: bytes
    scene: bytes
    fields: Integers
    changes: tuple[bytes, ...] = ()
    scene_moves: bool = False
    light_changes: bool = False

    @property
    def coefficients(self) -> int:
        """Number of layer coefficients of a frame."""
        of_scene = SCENE_COEFFICIENTS if self.scene_moves else 0
        of_light = LIGHT_COEFFICIENTS if self.light_changes else 0
        return len(self.fields) + len(self.changes) + of_scene + of_light


def field_shape(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of a motion field for source pictures of this size, 2 or more."""
    cells, longer = FIELD_POINTS - 1, max(width, height)
    return max(2, -(-cells * height // longer) + 1), max(2, -(-cells * width // longer) + 1)


def change_shape(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of a change, for source pictures of this size."""
    longer = max(width, height)
    rows, columns = (max(2, round(CHANGE_SIDE * side / longer)) for side in (height, width))
    return rows, columns


def change_codec(width: int, height: int) -> ModeCodec:
    """The codec of the changes of a call whose source pictures have this size."""
    rows, columns = change_shape(width, height)
    return ModeCodec(rows, width=columns)


def decode_changes(changes: tuple[bytes, ...], width: int, height: int) -> Single:
    """(c, rows, columns, 3) BGR, the changes.  Raises `ProtocolError` if one is damaged.

    width, height: of the source picture.
    """
    codec = change_codec(width, height)
    images = [codec.decode(f"change {number}", data) for number, data in enumerate(changes)]
    return np.array(images, np.float32).reshape(-1, *change_shape(width, height), 3)


def is_layered(background: bytes) -> bool:
    """Whether a model packet's background has layers."""
    return background[:1] in (TAG, FLAGGED_TAG)


def serialise_layers(layers: LayeredBackground) -> bytes:
    """The bytes of a layered background."""
    fields = bytes([len(layers.fields)]) + encode_fields(layers.fields)
    parts = (encode_mask(layers.mask), layers.person, fields)
    lengths = [encode_varint(len(part)) + part for part in parts]
    changes = [encode_varint(len(change)) + change for change in layers.changes]
    flags = _SCENE_MOVES * layers.scene_moves + _FINE_MASK * (len(layers.mask) == FINE_MASK_SIDE)
    flags += _LIGHT_CHANGES * layers.light_changes
    tag = FLAGGED_TAG + bytes([flags]) if flags else TAG
    return b"".join((tag, *lengths, bytes([len(changes)]), *changes, layers.scene))


def parse_layers(data: bytes, width: int, height: int) -> LayeredBackground:
    """The layered background in `data`, of source pictures of this size.

    Raises `ProtocolError` if the bytes are damaged; the pictures are not looked at.
    """
    reader = FieldReader(data[len(TAG) :])
    flags = _byte(reader, "flags") if data[:1] == FLAGGED_TAG else 0
    most = _SCENE_MOVES | _FINE_MASK | _LIGHT_CHANGES
    if flags > most or (not flags and data[:1] == FLAGGED_TAG):
        raise ProtocolError(f"background: flags are {flags}, expected 1 to {most}")
    side = FINE_MASK_SIDE if flags & _FINE_MASK else MASK_SIDE
    mask = decode_mask(_part(reader, "mask", MAX_MASK_BYTES), side)
    person = _part(reader, "person", MAX_IMAGE_BYTES)
    coded = _part(reader, "motion fields", MAX_FIELD_BYTES)
    if not coded or coded[0] > MAX_FIELDS:
        raise ProtocolError(f"background: no 0 to {MAX_FIELDS} motion fields")
    fields = decode_fields(coded[1:], (coded[0], *field_shape(width, height), 2))
    count = _byte(reader, "number of changes")
    if count > MAX_CHANGES:
        raise ProtocolError(f"background: {count} changes, limit {MAX_CHANGES}")
    changes = tuple(_part(reader, "change", MAX_IMAGE_BYTES) for _ in range(count))
    scene_moves, light_changes = bool(flags & _SCENE_MOVES), bool(flags & _LIGHT_CHANGES)
    return LayeredBackground(mask, person, reader.rest, fields, changes, scene_moves, light_changes)


def background_pictures(background: bytes, width: int, height: int) -> tuple[bytes, ...]:
    """The encoded pictures in any background.  width, height: see `parse_layers`."""
    if not is_layered(background):
        return (parse_background(background)[1],)
    layers = parse_layers(background, width, height)
    return layers.person, layers.scene


def encode_fields(fields: Integers) -> bytes:
    """The bytes of motion fields (k, rows, columns, 2), see `LayeredBackground`."""
    coder = RangeEncoder()
    _code_fields(coder, fields)
    return coder.finish()


def decode_fields(data: bytes, shape: tuple[int, ...]) -> Integers:
    """Motion fields of a shape (k, rows, columns, 2).  Raises `ProtocolError`."""
    coder = RangeDecoder(data)
    try:
        fields = _code_fields(coder, np.zeros(shape, np.int64))
    except ValueError as error:
        raise ProtocolError(f"background: motion fields: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"background: motion fields: {coder.unread_bytes} bytes too many")
    return fields


def _code_fields(coder: BitCoder, fields: Integers) -> Integers:
    """Code fields; a decoder uses only their shape.  Raises `ValueError` beyond the largest code.

    A code is predicted by left + above - (above left); codes outside the field are 0.
    """
    integers = AdaptiveIntegers(_CONTEXTS)
    known = np.zeros((*fields.shape[:1], 2, fields.shape[1] + 1, fields.shape[2] + 1), np.int64)
    for field, planes in zip(fields, known, strict=True):
        for axis, plane in enumerate(planes):
            for i, j in np.ndindex(*field.shape[:2]):
                above_left, above, left = (
                    int(plane[at]) for at in ((i, j), (i, j + 1), (i + 1, j))
                )
                prediction = left + above - above_left
                context = min(_CONTEXTS - 1, abs(above - above_left) + abs(left - above_left))
                value = prediction + integers.code(
                    coder, context, int(field[i, j, axis]) - prediction
                )
                if abs(value) > MAX_FIELD_CODE:
                    raise ValueError(f"a code is {value}, limit {MAX_FIELD_CODE}")
                plane[i + 1, j + 1] = value
    return known[..., 1:, 1:].transpose(0, 2, 3, 1)


def _byte(reader: FieldReader, name: str) -> int:
    if not reader.rest:
        raise ProtocolError(f"background ends before its {name}")
    return reader.byte()


def _part(reader: FieldReader, name: str, limit: int) -> bytes:
    """The next part, which follows after its length."""
    try:
        length = reader.varint()
    except ValueError as error:
        raise ProtocolError(f"background: {name}: {error}") from error
    if length > min(limit, len(reader.rest)):
        raise ProtocolError(f"background: {name} of {length} bytes, limit {limit}")
    return reader.take(length)
