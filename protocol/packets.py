"""The packets of a call: bytes in, frozen dataclasses out, and back.

Byte 0 of a packet holds its kind (top two bits) and a sequence number modulo 64, that of a layer
packet the number of the model that it refines; then the payload.
Every packet has exactly one encoding: `serialise(parse_packet(data)) == data`.  All else raises
`ProtocolError`, whatever the bytes, and no field may grow beyond its limit below.  Encoded images
are carried, not looked into.
"""

import math
import struct
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import msgpack  # type: ignore[import-untyped]
import numpy as np

from protocol.entropy.validation import (
    check_bool,
    check_bytes,
    check_codes,
    check_int,
    single,
    singles,
)
from protocol.entropy.varint import MAX_VARINT, decode_varint, encode_varint
from protocol.shape_residual_coding import parse_residual, serialise_residual
from shared_model.geometry import Camera, normalise
from shared_model.parameters import AAUS, EAUS, Pose

# A model packet is in the oldest version that has all it says: the thesis profile's, the default
# profile's pictures as they are coded now, fields for layers and coded frames, for growth, and for
# the thesis profile's lids.  Another matrix than bt601 makes no version: older programs refuse its
# number where they expect a profile's.
THESIS_VERSION, LIDS_VERSION, PLAIN_VERSION, LAYERED_VERSION, GROWING_VERSION = 2, 8, 9, 10, 11
_THESIS_VERSIONS = THESIS_VERSION, LIDS_VERSION
_DEFAULT_VERSIONS = PLAIN_VERSION, LAYERED_VERSION, GROWING_VERSION
VERSIONS = _THESIS_VERSIONS + _DEFAULT_VERSIONS
PROFILES = ("thesis", "default")
MATRICES = ("bt601", "bt709")

SEQUENCE_MODULUS = 64
MAX_MODEL_PACKET_BYTES = 256 * 1024
MAX_FRAME_PAYLOAD_BYTES = 1024
MAX_CONTROL_PACKET_BYTES = 16
MAX_IMAGE_BYTES = 128 * 1024
MAX_EXTENSION_BYTES = 128 * 1024
MAX_SIDE_PX = 8192
MAX_FPS_TERM = 1_000_000
MAX_FPS = 1000
MAX_FRAMES_PER_PACKET = 64
MAX_FRAME_STEP = 255
MAX_FOCAL_PX = 1e6
MAX_RESIDUAL_POINTS = 255
# More than so many points take as they are coded.
MAX_RESIDUAL_BYTES = 4096
MAX_TRANSLATION_MM = 1e6
MAX_LAYERS = 64
MAX_LAYER_PACKETS = 4096
MAX_LAYER_BYTES = 16 * 1024
MAX_FRAME_INDEX = MAX_VARINT
MAX_MESSAGE = 200


class ProtocolError(Exception):
    """Bytes from outside that are no packet; the message says what was wrong and where."""


class Kind(IntEnum):
    """Top two bits of byte 0."""

    FRAME = 0
    MODEL = 1
    CONTROL = 2
    LAYER = 3


class ControlKind(IntEnum):
    """What a control packet says."""

    END = 0  # the call is over; `frame` is the number of source frames it had
    LOST = 1  # the face has been lost at source frame `frame`
    FOUND = 2  # and found again at source frame `frame`


@dataclass(frozen=True, slots=True)
class CallParameters:
    """What stays the same throughout a call.

    profile: one of `PROFILES`.
    width, height: size of the source picture, pixels.
    fps_numerator, fps_denominator: frame rate of the source.
    focal_px: focal length, pixels; kept in single precision.
    frames_per_packet: coded frames in one frame packet (default profile).
    start_frame: source frame that frame packet 0 belongs to.
    frame_step: source frames from one coded frame to the next (default profile).
    lids: frame packets of the thesis profile say how far the lids are closed, too.
    matrix: one of `MATRICES`, by which the source's Y'CbCr was made; bt601 also where the source
        does not say or is RGB.  The first calls had none, so it shares a field with the profile.
    """

    profile: str
    width: int
    height: int
    fps_numerator: int
    fps_denominator: int
    focal_px: float
    frames_per_packet: int = 1
    start_frame: int = 0
    frame_step: int = 1
    lids: bool = False
    matrix: str = "bt601"

    def __post_init__(self) -> None:
        if self.profile not in PROFILES:
            raise ValueError(f"profile is {self.profile!r}, expected one of {PROFILES}")
        if self.matrix not in MATRICES:
            raise ValueError(f"matrix is {self.matrix!r}, expected one of {MATRICES}")
        check_int("width", self.width, 1, MAX_SIDE_PX)
        check_int("height", self.height, 1, MAX_SIDE_PX)
        check_int("fps numerator", self.fps_numerator, 1, MAX_FPS_TERM)
        check_int("fps denominator", self.fps_denominator, 1, MAX_FPS_TERM)
        if not 1 / MAX_FPS <= self.fps <= MAX_FPS:
            raise ValueError(f"fps is {self.fps}, expected 1/{MAX_FPS}..{MAX_FPS}")
        check_int("frames per packet", self.frames_per_packet, 1, MAX_FRAMES_PER_PACKET)
        check_int("start frame", self.start_frame, 0, MAX_FRAME_INDEX)
        check_int("frame step", self.frame_step, 1, MAX_FRAME_STEP)
        check_bool("lids", self.lids)
        if self.lids and self.profile != "thesis":
            raise ValueError(f"lids are an option of the thesis profile, not of the {self.profile}")
        focal = single("focal length", self.focal_px)
        if not 1 <= focal <= MAX_FOCAL_PX:
            raise ValueError(f"focal length is {focal} px, expected 1..{MAX_FOCAL_PX}")
        object.__setattr__(self, "focal_px", focal)

    @property
    def fps(self) -> float:
        """Frames per second of the source."""
        return self.fps_numerator / self.fps_denominator

    @property
    def camera(self) -> Camera:
        """The camera of the source."""
        return Camera(self.width, self.height, self.focal_px)


@dataclass(frozen=True, slots=True)
class ModelPacket:
    """Who calls: shape, still picture and texture; sent once, perhaps in several layers.

    call: what stays the same throughout the call.
    aau: len(AAUS) codes -128..127, see `quantise.AAU_STEP`.
    residual: x, y, z codes -128..127 of each control point, see `quantise.RESIDUAL_STEP_MM`.
    reference_rotation, reference_translation_mm: the pose of the frame the still was taken from,
        kept in single precision.
    reference_eau: len(EAUS) codes -127..127 of that frame, see `quantise.EAU_STEP`.
    background, texture: encoded images; without them an update keeps those before.
    extension: what a profile adds to the model, in that profile's own format.
    layer, layers: this packet is number `layer` of `layers` that replace one another.
    layered: its pictures are rough and modes are missing (empty), see `progressive_model`; they
        come in layer packets.
    growing: its extension has room for modes that are learned while the call goes on.
    """

    call: CallParameters
    aau: tuple[int, ...]
    reference_rotation: tuple[float, ...]
    reference_translation_mm: tuple[float, ...]
    reference_eau: tuple[int, ...]
    background: bytes = b""
    texture: bytes = b""
    residual: tuple[int, ...] = ()
    extension: bytes = b""
    layer: int = 0
    layers: int = 1
    sequence: int = 0
    layered: bool = False
    growing: bool = False

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_codes("aau", self.aau, len(AAUS), -128)
        check_codes("reference eau", self.reference_eau, len(EAUS), -127)
        if len(self.residual) % 3:
            raise ValueError(f"residual has {len(self.residual)} codes, expected three per point")
        check_int("number of residual points", len(self.residual) // 3, 0, MAX_RESIDUAL_POINTS)
        check_codes("residual", self.residual, len(self.residual), -128)
        check_bytes("background", self.background, MAX_IMAGE_BYTES)
        check_bytes("texture", self.texture, MAX_IMAGE_BYTES)
        check_bytes("extension", self.extension, MAX_EXTENSION_BYTES)
        check_int("number of layers", self.layers, 1, MAX_LAYERS)
        check_int("layer", self.layer, 0, self.layers - 1)
        check_bool("layered", self.layered)
        check_bool("growing", self.growing)
        rotation = singles("reference rotation", self.reference_rotation, 4, 1.001)
        norm = math.hypot(*rotation)
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"reference rotation has length {norm}, expected 1")
        translation = singles(
            "reference translation", self.reference_translation_mm, 3, MAX_TRANSLATION_MM
        )
        if translation[2] <= 0:
            raise ValueError(f"reference depth is {translation[2]} mm, expected more than 0")
        object.__setattr__(self, "reference_rotation", rotation)
        object.__setattr__(self, "reference_translation_mm", translation)

    @property
    def reference_pose(self) -> Pose:
        """The pose of the frame the still was taken from."""
        rotation = normalise(np.array(self.reference_rotation))
        return Pose(rotation, np.array(self.reference_translation_mm))

    def completed(self, before: "ModelPacket") -> "ModelPacket":
        """An update with the pictures of the model before, where it has none of its own."""
        return replace(
            self,
            background=self.background or before.background,
            texture=self.texture or before.texture,
        )


@dataclass(frozen=True, slots=True)
class FramePacket:
    """How the face is: `payload` in the format of the call's profile."""

    sequence: int
    payload: bytes

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_bytes("frame payload", self.payload, MAX_FRAME_PAYLOAD_BYTES)


@dataclass(frozen=True, slots=True)
class ControlPacket:
    """What happens in the call besides the face: see `ControlKind` for what `frame` means."""

    sequence: int
    kind: ControlKind
    frame: int

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_int("frame", self.frame, 0, MAX_FRAME_INDEX)


@dataclass(frozen=True, slots=True)
class LayerPacket:
    """A piece of what a layered model's first layer leaves out, see `protocol.progressive_model`.

    model: the `layer` of the model packet that it refines.
    number: of the piece, from 0 on.
    """

    model: int
    number: int
    data: bytes

    def __post_init__(self) -> None:
        check_int("model of a layer", self.model, 0, MAX_LAYERS - 1)
        check_int("number of a layer packet", self.number, 0, MAX_LAYER_PACKETS - 1)
        check_bytes("layer", self.data, MAX_LAYER_BYTES)
        if not self.data:
            raise ValueError("layer is empty")


Packet = ModelPacket | FramePacket | ControlPacket | LayerPacket


_MAX_PACKET_BYTES = {
    Kind.FRAME: 1 + MAX_FRAME_PAYLOAD_BYTES,
    Kind.MODEL: MAX_MODEL_PACKET_BYTES,
    Kind.CONTROL: MAX_CONTROL_PACKET_BYTES,
    # A number takes at most five bytes.
    Kind.LAYER: 6 + MAX_LAYER_BYTES,
}


def parse_packet(data: bytes) -> Packet:
    """The packet in `data`.

    Raises `ProtocolError` if it is none, is not in its one encoding, or a field is out of bounds.
    """
    kind = packet_kind(data)
    if len(data) > max_packet_bytes(kind):
        raise ProtocolError(f"{kind.name.lower()} packet of {len(data)} bytes is too long")
    sequence, payload = data[0] % SEQUENCE_MODULUS, bytes(data[1:])
    try:
        if kind is Kind.FRAME:
            return FramePacket(sequence, payload)
        if kind is Kind.CONTROL:
            return _parse_control(sequence, payload)
        if kind is Kind.LAYER:
            number, length = decode_varint(payload)
            return LayerPacket(sequence, number, payload[length:])
        return _parse_model(sequence, payload)
    except ValueError as error:
        raise ProtocolError(f"{kind.name.lower()} packet: {error}"[:MAX_MESSAGE]) from error


def serialise(packet: Packet) -> bytes:
    """The bytes of `packet`.  Raises `ValueError` if a model packet's parts exceed the limit."""
    if isinstance(packet, FramePacket):
        return _header(Kind.FRAME, packet.sequence) + packet.payload
    if isinstance(packet, ControlPacket):
        body = bytes([packet.kind]) + encode_varint(packet.frame)
        return _header(Kind.CONTROL, packet.sequence) + body
    if isinstance(packet, LayerPacket):
        return _header(Kind.LAYER, packet.model) + encode_varint(packet.number) + packet.data
    fields: bytes = msgpack.packb(_model_fields(packet), use_single_float=True)
    data = _header(Kind.MODEL, packet.sequence) + bytes([_version(packet)]) + fields
    if len(data) > MAX_MODEL_PACKET_BYTES:
        raise ValueError(f"model packet has {len(data)} bytes, limit {MAX_MODEL_PACKET_BYTES}")
    return data


def packet_kind(data: bytes) -> Kind:
    """The kind in byte 0 of a packet.  Raises `ProtocolError` if empty."""
    if not data:
        raise ProtocolError("empty packet")
    return Kind(data[0] // SEQUENCE_MODULUS)


def max_packet_bytes(kind: Kind) -> int:
    """The greatest length of a whole packet of `kind`, bytes."""
    return _MAX_PACKET_BYTES[kind]


def is_end(data: bytes) -> bool:
    """Whether `data` begins as a control packet that ends the call."""
    return (
        len(data) > 1 and data[0] // SEQUENCE_MODULUS == Kind.CONTROL and data[1] == ControlKind.END
    )


def _header(kind: Kind, sequence: int) -> bytes:
    return bytes([kind * SEQUENCE_MODULUS + sequence])


def _parse_control(sequence: int, payload: bytes) -> ControlPacket:
    if not payload:
        raise ValueError("kind of control missing")
    kind = ControlKind(payload[0])
    frame, length = decode_varint(payload[1:])
    if len(payload) != 1 + length:
        raise ValueError(f"{len(payload) - 1 - length} bytes too many")
    return ControlPacket(sequence, kind, frame)


# Keys of the model packet's map, short because they are sent.
_KEYS = ("p", "s", "r", "f", "n", "o", "l", "a", "d", "q", "t", "e", "b", "x", "m")
# How many of the later keys each version has.
_LATER_KEYS = ("k", "y", "g", "i")
_LATER = {
    THESIS_VERSION: 0,
    LIDS_VERSION: 4,
    PLAIN_VERSION: 0,
    LAYERED_VERSION: 2,
    GROWING_VERSION: 3,
}


def _version(packet: ModelPacket) -> int:
    if packet.call.lids:
        return LIDS_VERSION
    if packet.growing:
        return GROWING_VERSION
    if packet.layered or packet.call.frame_step != 1:
        return LAYERED_VERSION
    return THESIS_VERSION if packet.call.profile == "thesis" else PLAIN_VERSION


def _keys(version: int) -> tuple[str, ...]:
    return _KEYS + _LATER_KEYS[: _LATER[version]]


def _model_fields(packet: ModelPacket) -> dict[str, Any]:
    call, version = packet.call, _version(packet)
    values = (
        PROFILES.index(call.profile) + len(PROFILES) * MATRICES.index(call.matrix),
        (call.width, call.height),
        (call.fps_numerator, call.fps_denominator),
        call.focal_px,
        call.frames_per_packet,
        call.start_frame,
        (packet.layer, packet.layers),
        _bytes_from_codes(packet.aau),
        _bytes_from_residual(version, packet.residual),
        packet.reference_rotation,
        packet.reference_translation_mm,
        _bytes_from_codes(packet.reference_eau),
        packet.background,
        packet.texture,
        packet.extension,
        call.frame_step,
        packet.layered,
        packet.growing,
        call.lids,
    )
    return dict(zip(_keys(version), values, strict=False))


def _parse_model(sequence: int, payload: bytes) -> ModelPacket:
    version = payload[0] if payload else None
    if version not in VERSIONS:
        raise ValueError(
            f"format version is {'missing' if version is None else version},"
            f" this program reads {', '.join(map(str, VERSIONS))}"
        )
    fields = msgpack.unpackb(
        payload[1:],
        use_list=False,
        max_str_len=1,
        max_bin_len=MAX_IMAGE_BYTES,
        max_array_len=4,
        max_map_len=len(_keys(version)),
        max_ext_len=0,
    )
    packet = _model_from_fields(sequence, version, fields)
    if version == THESIS_VERSION and packet.call.profile != "thesis":
        raise ValueError(
            f"format version is {version}, of the default profile this program reads"
            f" {', '.join(map(str, _DEFAULT_VERSIONS))}"
        )
    # One encoding only: no longer integers, doubles or another order of keys for the same packet.
    if serialise(packet)[1:] != payload:
        raise ValueError("not in the one encoding of its fields")
    return packet


def _model_from_fields(sequence: int, version: int, fields: Any) -> ModelPacket:
    keys = _keys(version)
    if not isinstance(fields, dict) or tuple(fields) != keys:
        raise ValueError(f"no map of the fields {','.join(keys)}")
    profile, size, fps, focal, packing, start, layer, aau, residual, *rest = fields.values()
    rotation, translation, eau, background, texture, extension, *later = rest
    usual: tuple[Any, ...] = (1, False, False, False)
    step, layered, growing, lids = (*later, *usual[len(later) :])
    check_int("profile and matrix", profile, 0, len(PROFILES) * len(MATRICES) - 1)
    matrix, profile = divmod(profile, len(PROFILES))
    width, height = _pair("size", size)
    numerator, denominator = _pair("fps", fps)
    number, layers = _pair("layer", layer)
    return ModelPacket(
        call=CallParameters(
            PROFILES[profile],
            width,
            height,
            numerator,
            denominator,
            focal,
            packing,
            start,
            step,
            lids,
            MATRICES[matrix],
        ),
        aau=_codes_from_bytes("aau", aau),
        reference_rotation=rotation,
        reference_translation_mm=translation,
        reference_eau=_codes_from_bytes("reference eau", eau),
        background=background,
        texture=texture,
        residual=_residual_from_bytes(version, residual),
        extension=extension,
        layer=number,
        layers=layers,
        sequence=sequence,
        layered=layered,
        growing=growing,
    )


def _pair(name: str, value: Any) -> tuple[Any, Any]:
    if not isinstance(value, tuple) or len(value) != 2:
        raise ValueError(f"{name} is {value!r}, expected two numbers")
    return value


def _bytes_from_residual(version: int, codes: tuple[int, ...]) -> bytes:
    return _bytes_from_codes(codes) if version in _THESIS_VERSIONS else serialise_residual(codes)


def _residual_from_bytes(version: int, data: Any) -> tuple[int, ...]:
    if version in _THESIS_VERSIONS:
        return _codes_from_bytes("residual", data)
    check_bytes("residual", data, MAX_RESIDUAL_BYTES)
    return parse_residual(data)


def _bytes_from_codes(codes: tuple[int, ...]) -> bytes:
    return struct.pack(f"{len(codes)}b", *codes)


def _codes_from_bytes(name: str, data: Any) -> tuple[int, ...]:
    check_bytes(name, data, 3 * MAX_RESIDUAL_POINTS)
    return struct.unpack(f"{len(data)}b", data)
