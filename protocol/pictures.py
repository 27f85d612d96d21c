"""Colour pictures in a model packet: stills and textures, and appearance modes.

A still is `W`, width and height (varints), its relief behind its length (one byte), a step (one
byte), then its wavelet coefficients; a mode is a step and its coefficients, as large as the texture
it belongs to and under the texture's relief.  Luma and two colour differences are coded, these at
half the size and with less weight.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.messages import ProtocolError
from protocol.relief import decode_relief
from protocol.varint import decode_varint, encode_varint
from protocol.wavelet import SubbandCoder

Single = NDArray[np.float32]
Array = NDArray[np.float64]

MAGIC = b"W"
# How much an error of each colour difference counts against one of luma: in a still it shows as a
# blotch, in a mode it comes and goes.
STILL_CHROMA = 0.5
CHROMA = 0.3
# Of 2 ** (1 / STEPS_PER_OCTAVE) each.
STEPS_PER_OCTAVE = 8
MAX_STEP = 80
_LUMA = (0.114, 0.587, 0.299)


@dataclass(frozen=True, slots=True)
class _Kind:
    """Grey level about which luma is coded, and weight of colour."""

    offset: float
    chroma: float


_STILL, _MODE = _Kind(128.0, STILL_CHROMA), _Kind(0.0, CHROMA)


def to_luma(colours: NDArray[np.floating]) -> Single:
    """Luma (...,) of BGR colours (..., 3)."""
    return np.asarray(colours @ np.array(_LUMA, np.float32), np.float32)


def to_planes(colours: NDArray[np.floating], chroma: float = CHROMA) -> Single:
    """BGR colours (..., 3), or differences of such, to luma and weighted colour differences."""
    y = to_luma(colours)
    blue, red = colours[..., 0] - y, colours[..., 2] - y
    return np.asarray(np.stack([y, chroma * blue, chroma * red], -1), np.float32)


def from_planes(planes: NDArray[np.floating], chroma: float = CHROMA) -> Single:
    """The inverse of `to_planes`."""
    y = planes[..., 0]
    blue, red = y + planes[..., 1] / chroma, y + planes[..., 2] / chroma
    green = (y - _LUMA[0] * blue - _LUMA[2] * red) / _LUMA[1]
    return np.asarray(np.stack([blue, green, red], -1), np.float32)


def step_size(code: int) -> float:
    """The quantiser's step, grey levels."""
    return float(2 ** (code / STEPS_PER_OCTAVE))


def encode_still(colours: Single, step: int, relief: bytes = b"") -> tuple[bytes, Single]:
    """The bytes of a picture (h, w, 3), BGR 0..255, and what they decode to.

    step: 0..MAX_STEP.  relief: see `protocol.relief`; none: equally fine everywhere.
    """
    height, width = colours.shape[:2]
    head = MAGIC + encode_varint(width) + encode_varint(height) + bytes([len(relief)]) + relief
    planes = to_planes(colours, STILL_CHROMA)
    fineness = decode_relief("still", relief, height, width)
    data, decoded = _encode(SubbandCoder(), planes, step, _STILL, fineness)
    return head + data, decoded


@dataclass(frozen=True, slots=True)
class StillHead:
    """What comes before a still's coefficients, which start at byte `start`."""

    width: int
    height: int
    relief: bytes
    start: int


def still_head(name: str, data: bytes) -> StillHead:
    """What the head of a still says.

    name: what it is, for the message.  Raises `ProtocolError` if `data` does not start with one.
    """
    if not data.startswith(MAGIC):
        raise ProtocolError(f"{name} is no picture this program knows")
    try:
        width, used = decode_varint(data[len(MAGIC) :])
        start = len(MAGIC) + used
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
    return StillHead(width, height, relief, start + 1 + length)


def decode_still(name: str, data: bytes) -> Single:
    """The picture (h, w, 3), BGR, about 0..255.

    Raises `ProtocolError` if `data` is no still.  Check `still_head` first: any size is decoded.
    """
    head = still_head(name, data)
    fineness = decode_relief(name, head.relief, head.height, head.width)
    return _decode(SubbandCoder(), name, data[head.start :], _STILL, fineness)


class ModeSeries:
    """Codes the appearance modes of one caller, in order.

    size: of the texture, a side.  relief: the texture's.
    Raises `ProtocolError` if the relief is damaged.
    """

    def __init__(self, size: int, relief: bytes = b"") -> None:
        self._fineness = decode_relief("texture", relief, size, size)
        self._coder = SubbandCoder()

    def encode(self, planes: Single, step: int) -> tuple[bytes, Single]:
        """The bytes of a mode (size, size, 3), as `to_planes` makes it, and its decoded BGR."""
        return _encode(self._coder, planes, step, _MODE, self._fineness)

    def decode(self, name: str, data: bytes) -> Single:
        """The mode (size, size, 3), BGR.  Raises `ProtocolError` if `data` holds none."""
        return _decode(self._coder, name, data, _MODE, self._fineness)


def _encode(
    coder: SubbandCoder, planes: Single, step: int, kind: _Kind, fineness: Array
) -> tuple[bytes, Single]:
    luma = (planes[..., 0].astype(np.float64) - kind.offset) * fineness
    colour = [_halved(planes[..., i].astype(np.float64) * fineness) for i in (1, 2)]
    data, decoded = coder.encode([luma, *colour], step_size(step))
    return bytes([step]) + data, _colours(decoded, kind, fineness)


def _decode(coder: SubbandCoder, name: str, data: bytes, kind: _Kind, fineness: Array) -> Single:
    if not data or data[0] > MAX_STEP:
        raise ProtocolError(f"{name} has no step of 0..{MAX_STEP}")
    shape = fineness.shape
    half = -(-shape[0] // 2), -(-shape[1] // 2)
    planes = coder.decode(data[1:], [shape, half, half], step_size(data[0]))
    return _colours(planes, kind, fineness)


def _colours(planes: list[Array], kind: _Kind, fineness: Array) -> Single:
    height, width = fineness.shape
    colour = [_enlarged(_enlarged(plane, height).T, width).T for plane in planes[1:]]
    even = [plane / fineness for plane in (planes[0], *colour)]
    even[0] += kind.offset
    return from_planes(np.stack(even, -1).astype(np.float32), kind.chroma)


def _halved(plane: Array) -> Array:
    """Means of 2 x 2 values; an odd last row or column counts twice."""
    even = np.pad(plane, [(0, side % 2) for side in plane.shape], mode="edge")
    return np.asarray(
        (even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]) / 4
    )


def _enlarged(rows: Array, count: int) -> Array:
    """Rows at twice the density, bilinear, edges repeated; `count` of them."""
    at = np.clip((np.arange(count) + 0.5) / 2 - 0.5, 0, len(rows) - 1)
    low = np.minimum(at.astype(int), max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    share = (at - low)[:, None]
    return np.asarray(rows[low] * (1 - share) + rows[high] * share)
