"""Colour pictures in a model packet: stills and textures, and appearance modes.

A still is a letter, `S`, or `T` if it is a face's texture, its width and height (varints), its
relief behind its length (one byte), a step (one byte), then its wavelet coefficients; a mode is a
step and its coefficients, as large as the texture it belongs to and under the texture's relief.
Luma and two colour differences are coded, these at half the size and with less weight.  Which
integers the coefficients become is the encoder's choice: `encoder.picture_coding.picture_encoder`.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.pictures.probability_model import BACKGROUND, MODE, TEXTURE
from protocol.pictures.subband_coding import (
    PictureSequence,
    SubbandPyramid,
    decode_planes,
    dequantised,
)
from protocol.pictures.weight_map import decode_weight_map

Single = NDArray[np.float32]
Array = NDArray[np.float64]

TAGS = {BACKGROUND: b"S", TEXTURE: b"T"}
_KINDS = {letter: kind for kind, letter in TAGS.items()}
# How much an error of each colour difference counts against one of luma: in a still it shows as a
# blotch, in a mode it comes and goes.
INTRA_CHROMA_WEIGHT = 0.5
MODE_CHROMA_WEIGHT = 0.3
# Grey level about which a still's luma is coded.
LUMA_OFFSET = 128.0
# Of 2 ** (1 / STEPS_PER_OCTAVE) each.
STEPS_PER_OCTAVE = 8
MAX_STEP_CODE = 80
_LUMA = (0.114, 0.587, 0.299)


def to_luma(colours: NDArray[np.floating]) -> Single:
    """Luma (...,) of BGR colours (..., 3)."""
    return np.asarray(colours @ np.array(_LUMA, np.float32), np.float32)


def to_planes(colours: NDArray[np.floating], chroma: float = MODE_CHROMA_WEIGHT) -> Single:
    """BGR colours (..., 3), or differences of such, to luma and weighted colour differences."""
    y = to_luma(colours)
    blue, red = colours[..., 0] - y, colours[..., 2] - y
    return np.asarray(np.stack([y, chroma * blue, chroma * red], -1), np.float32)


def from_planes(planes: NDArray[np.floating], chroma: float = MODE_CHROMA_WEIGHT) -> Single:
    """The inverse of `to_planes`."""
    y = planes[..., 0]
    blue, red = y + planes[..., 1] / chroma, y + planes[..., 2] / chroma
    green = (y - _LUMA[0] * blue - _LUMA[2] * red) / _LUMA[1]
    return np.asarray(np.stack([blue, green, red], -1), np.float32)


def step_size(code: int) -> float:
    """The quantiser's step, grey levels."""
    return float(2 ** (code / STEPS_PER_OCTAVE))


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """How pictures of one kind and size are coded.

    kind: see `subbands.Series`.  fineness: (h, w), what planes are multiplied by.
    """

    kind: int
    weight_map: Array

    def weighted_planes(self, planes: Single) -> list[Array]:
        """What is coded of a picture (h, w, 3), as `to_planes` makes it: colours at half size."""
        offset = 0.0 if self.kind == MODE else LUMA_OFFSET
        luma = (planes[..., 0].astype(np.float64) - offset) * self.weight_map
        colour = [_downsampled(planes[..., i].astype(np.float64) * self.weight_map) for i in (1, 2)]
        return [luma, *colour]

    def picture_from_pyramids(self, pyramids: Sequence[SubbandPyramid], step: int) -> Single:
        """The picture (h, w, 3), BGR, of its coded planes."""
        planes = [dequantised(pyramid, step_size(step)) for pyramid in pyramids]
        height, width = self.weight_map.shape
        colour = [
            _upsampled_rows(_upsampled_rows(plane, height).T, width).T for plane in planes[1:]
        ]
        even = [plane / self.weight_map for plane in (planes[0], *colour)]
        even[0] += 0.0 if self.kind == MODE else LUMA_OFFSET
        return from_planes(np.stack(even, -1).astype(np.float32), self.chroma_weight)

    @property
    def chroma_weight(self) -> float:
        """Weight of colour."""
        return MODE_CHROMA_WEIGHT if self.kind == MODE else INTRA_CHROMA_WEIGHT

    def decode(self, series: PictureSequence, name: str, data: bytes) -> Single:
        """The next picture of a series.  Raises `ProtocolError` if `data` holds none."""
        if not data or data[0] > MAX_STEP_CODE:
            raise ProtocolError(f"{name} has no step of 0..{MAX_STEP_CODE}")
        pyramids = decode_planes(series, name, data[1:], plane_shapes(*self.weight_map.shape))
        return self.picture_from_pyramids(pyramids, data[0])


def plane_shapes(height: int, width: int) -> list[tuple[int, int]]:
    """Of luma and colours of a picture."""
    half = -(-height // 2), -(-width // 2)
    return [(height, width), half, half]


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """What comes before a still's coefficients, which start at byte `start`."""

    kind: int
    width: int
    height: int
    weight_map: bytes
    start: int

    def picture_format(self, name: str) -> PictureFormat:
        """How it is coded.  name: what it is, for the message.

        Raises `ProtocolError` if its relief is damaged.
        """
        return PictureFormat(
            self.kind, decode_weight_map(name, self.weight_map, self.height, self.width)
        )


def serialise_picture_header(kind: int, width: int, height: int, relief: bytes) -> bytes:
    """The bytes before a still's coefficients.  kind: `STILL` or `TEXTURE`."""
    return TAGS[kind] + encode_varint(width) + encode_varint(height) + bytes([len(relief)]) + relief


def is_picture(data: bytes) -> bool:
    """Whether `data` begins as a still does."""
    return data[:1] in _KINDS


def parse_picture_header(name: str, data: bytes) -> PictureHeader:
    """What the head of a still says.

    name: what it is, for the message.  Raises `ProtocolError` if `data` does not start with one.
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
    relief = data[start + 1 : start + 1 + length]
    if start >= len(data) or len(relief) < length:
        raise ProtocolError(f"{name} ends in its head")
    return PictureHeader(_KINDS[data[:1]], width, height, relief, start + 1 + length)


def decode_picture(name: str, data: bytes) -> Single:
    """The picture (h, w, 3), BGR, about 0..255.

    Raises `ProtocolError` if `data` is no still.  Check `still_head` first: any size is decoded.
    """
    head = parse_picture_header(name, data)
    return head.picture_format(name).decode(PictureSequence(head.kind), name, data[head.start :])


class ModeDecoder:
    """Codes the appearance modes of one caller, in order.

    size: of the texture, a side.  relief: the texture's.
    Raises `ProtocolError` if the relief is damaged.
    """

    def __init__(self, size: int, weight_map: bytes = b"") -> None:
        self.format = PictureFormat(MODE, decode_weight_map("texture", weight_map, size, size))
        self.sequence = PictureSequence(MODE)

    def copy(self) -> "ModeDecoder":
        """What can go on by itself."""
        copied = copy(self)
        copied.sequence = self.sequence.copy()
        return copied

    def decode(self, name: str, data: bytes) -> Single:
        """The next mode (size, size, 3), BGR.  Raises `ProtocolError` if `data` holds none."""
        return self.format.decode(self.sequence, name, data)


def _downsampled(plane: Array) -> Array:
    """Means of 2 x 2 values; an odd last row or column counts twice."""
    even = np.pad(plane, [(0, side % 2) for side in plane.shape], mode="edge")
    return np.asarray(
        (even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]) / 4
    )


def _upsampled_rows(rows: Array, count: int) -> Array:
    """Rows at twice the density, bilinear, edges repeated; `count` of them."""
    at = np.clip((np.arange(count) + 0.5) / 2 - 0.5, 0, len(rows) - 1)
    low = np.minimum(at.astype(int), max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    share = (at - low)[:, None]
    return np.asarray(rows[low] * (1 - share) + rows[high] * share)
