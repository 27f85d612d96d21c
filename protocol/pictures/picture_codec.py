"""The picture codec: colour pictures of model packets, and appearance modes.

A picture is a tag (`S` a background, `T` a texture), its width and height (varints), its weight map
after the map's length (one byte), a step code (one byte), then its wavelet coefficients.  A mode is
a step code and its coefficients; it has the size and the weight map of its texture.  Luma and two
colour differences are coded, these at half the size and with a lower weight.
`encoder.picture_coding.picture_encoder` chooses the integers of the coefficients.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.pictures.plane_decoding import decode_planes
from protocol.pictures.probability_model import BACKGROUND, MODE, TEXTURE
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid, dequantised
from protocol.pictures.weight_map import decode_weight_map
from shared_model.arrays import Array, Single

TAGS = {BACKGROUND: b"S", TEXTURE: b"T"}
_KINDS = {tag: kind for kind, tag in TAGS.items()}
# Weight of the colour differences against luma.  Errors of a picture's colour are visible in all
# frames, those of a mode in few.
INTRA_CHROMA_WEIGHT = 0.5
MODE_CHROMA_WEIGHT = 0.3
# Subtracted from the luma of a picture, grey levels.
LUMA_OFFSET = 128.0
# The quantiser's step doubles with every so many step codes.
STEPS_PER_OCTAVE = 8
MAX_STEP_CODE = 80
# Of blue, green and red.
LUMA_BGR = (0.114, 0.587, 0.299)


def to_luma(colours: NDArray[np.floating]) -> Single:
    """Luma (...,) of BGR colours (..., 3)."""
    return np.asarray(colours @ np.array(LUMA_BGR, np.float32), np.float32)


def to_planes(colours: NDArray[np.floating], chroma_weight: float = MODE_CHROMA_WEIGHT) -> Single:
    """Luma and weighted colour differences (..., 3) of BGR colours, or of their differences."""
    y = to_luma(colours)
    blue, red = colours[..., 0] - y, colours[..., 2] - y
    return np.asarray(np.stack([y, chroma_weight * blue, chroma_weight * red], -1), np.float32)


def from_planes(planes: NDArray[np.floating], chroma_weight: float = MODE_CHROMA_WEIGHT) -> Single:
    """The inverse of `to_planes`."""
    y = planes[..., 0]
    blue, red = y + planes[..., 1] / chroma_weight, y + planes[..., 2] / chroma_weight
    green = (y - LUMA_BGR[0] * blue - LUMA_BGR[2] * red) / LUMA_BGR[1]
    return np.asarray(np.stack([blue, green, red], -1), np.float32)


def step_size(code: int) -> float:
    """The quantiser's step of a step code, grey levels."""
    return float(2 ** (code / STEPS_PER_OCTAVE))


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """How pictures of one kind and size are coded.

    kind: `BACKGROUND`, `TEXTURE` or `MODE`.
    weight_map: (h, w), by which the planes are multiplied before quantisation.
    """

    kind: int
    weight_map: Array

    @property
    def chroma_weight(self) -> float:
        """Weight of the colour differences against luma."""
        return MODE_CHROMA_WEIGHT if self.kind == MODE else INTRA_CHROMA_WEIGHT

    def weighted_planes(self, planes: Single) -> list[Array]:
        """The planes that are transformed; the colour differences have half the size.

        planes: (h, w, 3) of `to_planes`.
        """
        offset = 0.0 if self.kind == MODE else LUMA_OFFSET
        luma = (planes[..., 0].astype(np.float64) - offset) * self.weight_map
        chroma = [_downsampled(planes[..., i].astype(np.float64) * self.weight_map) for i in (1, 2)]
        return [luma, *chroma]

    def picture_from_pyramids(self, pyramids: Sequence[SubbandPyramid], step: int) -> Single:
        """The picture (h, w, 3), BGR, of quantised planes.  step: step code."""
        planes = [dequantised(pyramid, step_size(step)) for pyramid in pyramids]
        height, width = self.weight_map.shape
        chroma = [
            _upsampled_rows(_upsampled_rows(plane, height).T, width).T for plane in planes[1:]
        ]
        unweighted = [plane / self.weight_map for plane in (planes[0], *chroma)]
        unweighted[0] += 0.0 if self.kind == MODE else LUMA_OFFSET
        return from_planes(np.stack(unweighted, -1).astype(np.float32), self.chroma_weight)

    def decode(self, sequence: PictureSequence, name: str, data: bytes) -> Single:
        """Decode step code and coefficients: the next picture (h, w, 3), BGR, of a sequence.

        name: of the picture, for the message.  Raises `ProtocolError` if `data` is damaged.
        """
        if not data or data[0] > MAX_STEP_CODE:
            raise ProtocolError(f"{name} has no step of 0..{MAX_STEP_CODE}")
        pyramids = decode_planes(sequence, name, data[1:], plane_shapes(*self.weight_map.shape))
        return self.picture_from_pyramids(pyramids, data[0])


def plane_shapes(height: int, width: int) -> list[tuple[int, int]]:
    """Shapes of the three planes of a picture."""
    half = -(-height // 2), -(-width // 2)
    return [(height, width), half, half]


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """The header of a picture.

    kind: `BACKGROUND` or `TEXTURE`.
    weight_map: encoded, see `weight_map`; may be empty.
    start: offset of the step code in the picture's bytes.
    """

    kind: int
    width: int
    height: int
    weight_map: bytes
    start: int

    def picture_format(self, name: str) -> PictureFormat:
        """The picture's format.  Raises `ProtocolError` if the weight map is damaged.

        name: of the picture, for the message.
        """
        weights = decode_weight_map(name, self.weight_map, self.height, self.width)
        return PictureFormat(self.kind, weights)


def serialise_picture_header(kind: int, width: int, height: int, weight_map: bytes) -> bytes:
    """The bytes before a picture's step code.  kind: `BACKGROUND` or `TEXTURE`."""
    size = encode_varint(width) + encode_varint(height)
    return TAGS[kind] + size + bytes([len(weight_map)]) + weight_map


def is_picture(data: bytes) -> bool:
    """Whether `data` begins with the tag of a picture."""
    return data[:1] in _KINDS


def parse_picture_header(name: str, data: bytes) -> PictureHeader:
    """The header of the picture in `data`.

    name: of the picture, for the message.  Raises `ProtocolError` if the header is damaged.
    """
    if not is_picture(data):
        raise ProtocolError(f"{name} is no picture this program knows")
    try:
        width, used = decode_varint(data[1:])
        start = 1 + used
        height, used = decode_varint(data[start:])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if not width or not height:
        raise ProtocolError(f"{name} is {width}x{height}")
    start += used
    length = data[start] if start < len(data) else 0
    weight_map = data[start + 1 : start + 1 + length]
    if start >= len(data) or len(weight_map) < length:
        raise ProtocolError(f"{name} ends in its header")
    return PictureHeader(_KINDS[data[:1]], width, height, weight_map, start + 1 + length)


def decode_picture(name: str, data: bytes) -> Single:
    """The picture (h, w, 3), BGR, about 0..255.

    Decodes any size: check `parse_picture_header` first.
    Raises `ProtocolError` if `data` is damaged.
    """
    header = parse_picture_header(name, data)
    picture_format = header.picture_format(name)
    return picture_format.decode(PictureSequence(header.kind), name, data[header.start :])


class ModeCodec:
    """The state in which the next appearance mode of a caller is coded or decoded.

    size: side of the texture, texels; of pictures that are not square their height.
    weight_map: of the texture, encoded.
    width: None: as the height.
    Raises `ProtocolError` if the weight map is damaged.
    """

    def __init__(self, size: int, weight_map: bytes = b"", width: int | None = None) -> None:
        weights = decode_weight_map("texture", weight_map, size, size if width is None else width)
        self.format = PictureFormat(MODE, weights)
        self.sequence = PictureSequence(MODE)

    def copy(self) -> "ModeCodec":
        """An independent copy."""
        copied = copy(self)
        copied.sequence = self.sequence.copy()
        return copied

    def decode(self, name: str, data: bytes) -> Single:
        """The next mode (size, size, 3), BGR.  Raises `ProtocolError` if `data` is damaged."""
        return self.format.decode(self.sequence, name, data)


def _downsampled(plane: Array) -> Array:
    """Means of 2 x 2 values; an odd last row or column counts twice."""
    even = np.pad(plane, [(0, side % 2) for side in plane.shape], mode="edge")
    return np.asarray(
        (even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]) / 4
    )


def _upsampled_rows(rows: Array, count: int) -> Array:
    """`count` rows at twice the resolution: bilinear, edges repeated."""
    at = np.clip((np.arange(count) + 0.5) / 2 - 0.5, 0, len(rows) - 1)
    low = np.minimum(at.astype(int), max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    fraction = (at - low)[:, None]
    return np.asarray(rows[low] * (1 - fraction) + rows[high] * fraction)
