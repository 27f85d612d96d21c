"""The packets of a call: bytes in, frozen dataclasses out, and back.

Byte 0 of a packet holds its kind (top two bits) and a number modulo 64: the sequence number, or, in
a layer packet, the version of the model that the layer belongs to.  The payload follows.
Every packet has exactly one encoding: `serialise(parse_packet(data)) == data`.  Any other bytes
raise `ProtocolError`, and no field exceeds its limit of `protocol.limits`.  Encoded pictures are
carried without being decoded.  The format is specified in docs/format.md.
"""

from dataclasses import dataclass
from enum import IntEnum

from protocol.entropy.validation import check_bytes, check_int
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.frames.frame_times import TimesPacket, parse_times, serialise_times
from protocol.limits import (
    MAX_CONTROL_PACKET_BYTES,
    MAX_FRAME_INDEX,
    MAX_FRAME_PAYLOAD_BYTES,
    MAX_LAYER_BYTES,
    MAX_LAYER_PACKETS,
    MAX_MESSAGE_LENGTH,
    MAX_MODEL_PACKET_BYTES,
    MAX_MODEL_VERSIONS,
    SEQUENCE_MODULUS,
)
from protocol.model_packet import ModelPacket, parse_model, serialise_model


class PacketKind(IntEnum):
    """Top two bits of byte 0."""

    FRAME = 0
    MODEL = 1
    CONTROL = 2
    LAYER = 3


class ControlKind(IntEnum):
    """The event that a control packet reports, with the meaning of its `frame`."""

    END = 0  # the call is over; `frame` is its number of source frames, or of those since JOINED
    FACE_LOST = 1  # no face from source frame `frame` on
    FACE_FOUND = 2  # a face again from source frame `frame` on
    TIMES = 3  # a `TimesPacket`: when source frames from `frame` on are shown
    CAMERA_OFF = 4  # the camera is off from source frame `frame` on; the faces go to rest
    CAMERA_ON = 5  # it is on again from source frame `frame` on
    PERSON_GONE = 6  # the lost face's person is not there from source frame `frame` on
    JOINED = 7  # a file begins with source frame `frame`, in the middle of the call


@dataclass(frozen=True, slots=True)
class FramePacket:
    """The faces of one or several frames: `payload` in the format of the call's profile."""

    sequence: int
    payload: bytes

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_bytes("frame payload", self.payload, MAX_FRAME_PAYLOAD_BYTES)


@dataclass(frozen=True, slots=True)
class ControlPacket:
    """An event of the call at a source frame, see `ControlKind`; TIMES has a class of its own."""

    sequence: int
    kind: ControlKind
    frame: int

    def __post_init__(self) -> None:
        if self.kind is ControlKind.TIMES:
            raise ValueError("kind of control is TIMES, expected a TimesPacket")
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_int("frame", self.frame, 0, MAX_FRAME_INDEX)


@dataclass(frozen=True, slots=True)
class LayerPacket:
    """A piece of the stream that completes a model, see `protocol.progressive_model`.

    model_version: the `version` of the model packet that the stream completes.
    number: index of the piece in the stream, from 0.
    data: at least one byte.
    """

    model_version: int
    number: int
    data: bytes

    def __post_init__(self) -> None:
        check_int("model version", self.model_version, 0, MAX_MODEL_VERSIONS - 1)
        check_int("number of a layer packet", self.number, 0, MAX_LAYER_PACKETS - 1)
        check_bytes("layer", self.data, MAX_LAYER_BYTES)
        if not self.data:
            raise ValueError("layer is empty")


Packet = ModelPacket | FramePacket | ControlPacket | TimesPacket | LayerPacket


_MAX_PACKET_BYTES = {
    PacketKind.FRAME: 1 + MAX_FRAME_PAYLOAD_BYTES,
    PacketKind.MODEL: MAX_MODEL_PACKET_BYTES,
    PacketKind.CONTROL: MAX_CONTROL_PACKET_BYTES,
    # A varint takes at most five bytes.
    PacketKind.LAYER: 6 + MAX_LAYER_BYTES,
}


def parse_packet(data: bytes) -> Packet:
    """The packet that `data` encodes.

    Raises `ProtocolError` if `data` is not the one encoding of a packet whose fields are in bounds.
    """
    kind = packet_kind(data)
    if len(data) > max_packet_bytes(kind):
        raise ProtocolError(f"{kind.name.lower()} packet of {len(data)} bytes is too long")
    sequence, payload = data[0] % SEQUENCE_MODULUS, bytes(data[1:])
    try:
        if kind is PacketKind.FRAME:
            return FramePacket(sequence, payload)
        if kind is PacketKind.CONTROL:
            return _parse_control(sequence, payload)
        if kind is PacketKind.LAYER:
            number, length = decode_varint(payload)
            return LayerPacket(sequence, number, payload[length:])
        return parse_model(sequence, payload)
    except ValueError as error:
        raise ProtocolError(f"{kind.name.lower()} packet: {error}"[:MAX_MESSAGE_LENGTH]) from error


def serialise(packet: Packet) -> bytes:
    """The bytes of `packet`.  Raises `ValueError` if a model packet's parts exceed the limit."""
    if isinstance(packet, FramePacket):
        return _header(PacketKind.FRAME, packet.sequence) + packet.payload
    if isinstance(packet, ControlPacket):
        body = bytes([packet.kind]) + encode_varint(packet.frame)
        return _header(PacketKind.CONTROL, packet.sequence) + body
    if isinstance(packet, TimesPacket):
        body = bytes([ControlKind.TIMES]) + serialise_times(packet)
        return _header(PacketKind.CONTROL, packet.sequence) + body
    if isinstance(packet, LayerPacket):
        return (
            _header(PacketKind.LAYER, packet.model_version)
            + encode_varint(packet.number)
            + packet.data
        )
    data = _header(PacketKind.MODEL, packet.sequence) + serialise_model(packet)
    if len(data) > MAX_MODEL_PACKET_BYTES:
        raise ValueError(f"model packet has {len(data)} bytes, limit {MAX_MODEL_PACKET_BYTES}")
    return data


def packet_kind(data: bytes) -> PacketKind:
    """The kind in byte 0 of a packet.  Raises `ProtocolError` if `data` is empty."""
    if not data:
        raise ProtocolError("empty packet")
    return PacketKind(data[0] // SEQUENCE_MODULUS)


def max_packet_bytes(kind: PacketKind) -> int:
    """The greatest length of a whole packet of `kind`, bytes."""
    return _MAX_PACKET_BYTES[kind]


def is_end(data: bytes) -> bool:
    """Whether `data` begins like the control packet that ends a call."""
    return (
        len(data) > 1
        and data[0] // SEQUENCE_MODULUS == PacketKind.CONTROL
        and data[1] == ControlKind.END
    )


def _header(kind: PacketKind, sequence: int) -> bytes:
    return bytes([kind * SEQUENCE_MODULUS + sequence])


def _parse_control(sequence: int, payload: bytes) -> ControlPacket | TimesPacket:
    if not payload:
        raise ValueError("kind of control missing")
    kind = ControlKind(payload[0])
    if kind is ControlKind.TIMES:
        return parse_times(sequence, payload[1:])
    frame, length = decode_varint(payload[1:])
    if len(payload) != 1 + length:
        raise ValueError(f"{len(payload) - 1 - length} bytes too many")
    return ControlPacket(sequence, kind, frame)
