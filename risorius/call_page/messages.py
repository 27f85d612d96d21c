"""What server and page say to each other over the WebSocket.

Text messages are JSON objects; `kind` says what they are about.  Binary messages are pictures: a
header of 24 bytes, little endian, then a JPEG file.

    0   uint8    which picture, see `Stream`
    1   uint8    1: it repeats an older face
    4   uint32   index of the source frame
    8   float64  its time in the source, seconds
    16  float64  when it was drawn, ms since 1970
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from protocol.errors import ProtocolError

_HEADER = struct.Struct("<BB2xIdd")
MAX_JPEG_BYTES = 4 << 20


class Stream(IntEnum):
    """Whose picture a message holds."""

    OTHER = 1  # the other person, decoded
    SELF = 2  # this person as the others see them, decoded
    CAMERA = 3  # from page to server: this person's camera


@dataclass(frozen=True, slots=True)
class PictureMessage:
    """One picture.

    index, time_s: of the source frame.  made_ms: when it was drawn or taken, ms since 1970.
    frozen: it repeats an older face.
    """

    stream: Stream
    index: int
    time_s: float
    made_ms: float
    jpeg: bytes
    frozen: bool = False


def serialise_picture(message: PictureMessage) -> bytes:
    """The bytes of a message, as above."""
    header = _HEADER.pack(
        message.stream, message.frozen, message.index, message.time_s, message.made_ms
    )
    return header + message.jpeg


def parse_picture(data: bytes) -> PictureMessage:
    """The message in `data`.  Raises `ProtocolError` if it is none."""
    if not _HEADER.size < len(data) <= _HEADER.size + MAX_JPEG_BYTES:
        raise ProtocolError(f"picture message of {len(data)} bytes")
    stream, frozen, index, time_s, made_ms = _HEADER.unpack_from(data)
    if stream not in list(Stream) or frozen > 1:
        raise ProtocolError(f"picture message of stream {stream}, flag {frozen}")
    jpeg = bytes(data[_HEADER.size :])
    return PictureMessage(Stream(stream), index, time_s, made_ms, jpeg, bool(frozen))
