"""The appearance model (thesis eq. 2.17): mean texture and modes, decoded from a model packet."""

from collections.abc import Callable
from copy import copy
from itertools import takewhile
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.rendering.closed_lids import ClosedLids
from decoder.rendering.texture_colour import LocalColours
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import MAX_MODES
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.pictures.picture_codec import (
    ModeCodec,
    decode_picture,
    is_picture,
    parse_picture_header,
)
from shared_model.arrays import Array, Picture, Single
from shared_model.surround import blend_surround_seam

# An image of a few kilobytes may state any size; this limits the memory of its decoding.
MAX_IMAGE_SIDE_PX = 4096
MAX_ATLAS_SIDE_PX = 1024
# Of pictures of `protocol.pictures.picture_codec`, which takes time for each pixel.
MAX_CODED_SIDE_PX = 1024
# All modes together; each texel takes 12 bytes.
MAX_MODE_TEXELS = 4 * 1024 * 1024


def go_on() -> None:
    """Wait for nothing."""


class FrameTextures:
    """The texture of each frame: mean + modes x coefficients (eq. 2.17).

    give_way: see `update`.
    Raises `ProtocolError` if an image of the model packet is damaged or of another size.
    """

    def __init__(self, model: ModelPacket, give_way: Callable[[], None] = go_on) -> None:
        self._modes: _ModeRows
        # The picture that could not be decoded; the modes after it depend on it.
        self._damaged: bytes | None = None
        self._has_surround = model.call.profile == "default"
        self._load_texture(model)
        self.update(model, give_way)

    @property
    def has_modes(self) -> bool:
        """Whether any mode has been received."""
        return bool(len(self._modes))

    @property
    def changes(self) -> bool:
        """Whether the texture changes from frame to frame: by modes, or as the eyes close."""
        return self._lids is not None or self.has_modes

    def update(self, model: ModelPacket, give_way: Callable[[], None] = go_on) -> None:
        """Decode what further layers have added to the model.

        give_way: called before each mode; waits while what is more urgent is decoded.
        Raises `ProtocolError` as the constructor does, once for each damaged picture.
        """
        if model.texture != self._texture:
            if model.texture == self._damaged:
                return
            self._load_texture(model)
        coded = parse_transform(model.profile_data).modes if model.profile_data else ()
        if model.progressive or model.extensible:
            coded = tuple(takewhile(bool, coded))
        size = len(self._mean)
        if len(coded) * size * size > MAX_MODE_TEXELS:
            raise ProtocolError(
                f"{len(coded)} modes of {size}x{size}, limit {MAX_MODE_TEXELS} texels"
            )
        known = len(self._modes)
        for number, data in enumerate(coded[known:], known):
            if data == self._damaged:
                break
            give_way()
            self._damaged = data
            image = self._codec.decode(f"mode {number}", data)
            self._damaged = None
            if self._colours is not None:
                image = self._colours.complete(image)
            self._modes = self._modes.with_row(self._to_atlas(image).ravel())

    def updated(
        self, model: ModelPacket, give_way: Callable[[], None] = go_on
    ) -> "tuple[FrameTextures, ProtocolError | None]":
        """A copy after `update`, and what that raises."""
        other = copy(self)
        other._codec = self._codec.copy()
        try:
            other.update(model, give_way)
        except ProtocolError as error:
            return other, error
        return other, None

    def _load_texture(self, model: ModelPacket) -> None:
        self._damaged = model.texture
        mean = decode_image("texture", model.texture, MAX_ATLAS_SIDE_PX)
        _check_square("texture", mean)
        codec = ModeCodec(len(mean), _weight_map(model.texture))
        self._texture, self._codec = model.texture, codec
        self._mean = np.asarray(self._to_atlas(mean) + 0.5, np.uint8)
        self._colours = LocalColours(self._mean) if self._has_surround else None
        self._lids = ClosedLids(self._mean) if self._has_surround else None
        self._damaged = None
        self._modes = _ModeRows(mean.size)

    def _to_atlas(self, image: NDArray[Any]) -> Single:
        """A decoded picture as an atlas of the head."""
        atlas = image.astype(np.float32)
        return blend_surround_seam(atlas) if self._has_surround else atlas

    def synthesise(self, coefficients: Array, lids: Array | None = None) -> Picture:
        """The atlas (size, size, 3) uint8 BGR.

        coefficients: (m,) of the modes, or empty for the mean; those of modes that have not been
            received are ignored.
        lids: (2,) actuators of the eyelids, left and right; None: the eyes are open.
        """
        texture = self._with_modes(coefficients)
        if self._lids is None or lids is None:
            return texture
        return self._lids.lightened(texture, lids)

    def _with_modes(self, coefficients: Array) -> Picture:
        if not coefficients.size:
            return self._mean
        flat = coefficients[: len(self._modes)].astype(np.float32) @ self._modes.rows
        if self._colours is not None:
            return self._colours.texture(flat)
        flat += self._mean.ravel()
        # Adding 0.5 and truncating is faster than rounding.
        flat += np.float32(0.5)
        return np.asarray(np.clip(flat, 0, 255), np.uint8).reshape(self._mean.shape)


class _ModeRows:
    """The modes of one texture as rows (m, size) float32.

    A model is drawn while further modes of it are decoded: with each one there are new rows.  They
    share the memory of those before: to copy up to 48 MB takes longer than to decode a mode.
    """

    def __init__(self, size: int) -> None:
        most = min(MAX_MODES, MAX_MODE_TEXELS * 3 // size)
        self._memory = np.empty((most, size), np.float32)  # takes memory as it is written
        self._written = [0]  # rows of the memory, of all that share it
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> Single:
        """The rows."""
        return self._memory[: self._count]

    def with_row(self, row: Single) -> "_ModeRows":
        """These rows and one more (size,)."""
        longer = copy(self)
        if self._written[0] != self._count:
            # Others have gone on from here already, as after a damaged mode.
            longer._memory, longer._written = np.empty_like(self._memory), [self._count]
            longer._memory[: self._count] = self.rows
        longer._memory[self._count] = row
        longer._count = longer._written[0] = self._count + 1
        return longer


def decode_image(name: str, data: bytes, limit_px: int = MAX_IMAGE_SIDE_PX) -> Picture:
    """The picture (h, w, 3) uint8 BGR in `data`, of the picture codec or a WebP file.

    name: of the picture, for the message.
    limit_px: maximum of width and height.
    Raises `ProtocolError` if `data` is neither, is damaged, or is too large.
    """
    own = is_picture(data)
    limit_px = min(limit_px, MAX_CODED_SIDE_PX) if own else limit_px
    width, height = _coded_size(name, data) if own else _webp_size(name, data)
    if not (1 <= width <= limit_px and 1 <= height <= limit_px):
        raise ProtocolError(f"{name} is {width}x{height}, limit {limit_px} a side")
    if own:
        return np.asarray(np.clip(decode_picture(name, data) + 0.5, 0, 255), np.uint8)
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise ProtocolError(f"{name} is a damaged image of {len(data)} bytes") from error
    if picture is None:
        raise ProtocolError(f"{name} is a damaged image of {len(data)} bytes")
    return np.asarray(picture, dtype=np.uint8)


def _weight_map(texture: bytes) -> bytes:
    """The encoded weight map that modes share with their texture; WebP has none."""
    return parse_picture_header("texture", texture).weight_map if is_picture(texture) else b""


def _check_square(name: str, image: Picture) -> None:
    height, width = image.shape[:2]
    if width != height or width < 2:
        raise ProtocolError(f"{name} is {width}x{height}, expected a square of at least 2x2")


def _coded_size(name: str, data: bytes) -> tuple[int, int]:
    head = parse_picture_header(name, data)
    return head.width, head.height


def _webp_size(name: str, data: bytes) -> tuple[int, int]:
    """Width and height in the file's first chunk (RFC 9649, 2.5 to 2.7)."""
    if len(data) < 30 or data[:4] != b"RIFF" or data[8:12] != b"WEBP":
        raise ProtocolError(f"{name} is no WebP image: {len(data)} bytes")
    chunk = data[12:16]
    if chunk == b"VP8 ":
        return _u16(data, 26) & 0x3FFF, _u16(data, 28) & 0x3FFF
    if chunk == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if chunk == b"VP8X":
        return (
            int.from_bytes(data[24:27], "little") + 1,
            int.from_bytes(data[27:30], "little") + 1,
        )
    raise ProtocolError(f"{name} is a WebP image of unknown kind {chunk!r}")


def _u16(data: bytes, offset: int) -> int:
    return int.from_bytes(data[offset : offset + 2], "little")
