"""What server and page say to each other over the WebSocket.

Text messages are JSON objects; `kind` says what they are about.  Binary messages are pictures and
pieces of sound: a header of 24 bytes, little endian, then a JPEG file, or samples (int16, mono).

    0   uint8    which picture or sound, see `Stream`
    1   uint8    of a picture, 1: it repeats an older face; 2: as nothing has come; of a sound, 0
    2   uint16   of a decoded picture, how long its packet had been there when it was drawn, ms
    4   uint32   index of the source frame; of a sound, samples per second
    8   float64  its time in the source, of a sound that of its first sample, seconds
    16  float64  when it was drawn or taken, ms since 1970
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite

from protocol.errors import ProtocolError

_HEADER = struct.Struct("<BBHIdd")
MAX_WAITED_MS = (1 << 16) - 1
MAX_JPEG_BYTES = 4 << 20
# Of a piece of sound: some seconds.
MAX_SOUND_BYTES = 1 << 20
MAX_RATE_HZ = 192_000


class Stream(IntEnum):
    """Whose picture a message holds."""

    OTHER = 1  # the other person, decoded
    SELF = 2  # this person as the others see them, decoded
    CAMERA = 3  # from page to server: this person's camera
    VOICE = 4  # the other person's voice
    MICROPHONE = 5  # from page to server: this person's voice


PICTURES = (Stream.OTHER, Stream.SELF, Stream.CAMERA)


@dataclass(frozen=True, slots=True)
class PictureMessage:
    """One picture.

    index, time_s: of the source frame.  made_ms: when it was drawn or taken, ms since 1970.
    frozen: it repeats an older face; lost: since nothing has come.
    waited_ms: from the arrival of its packet until it was drawn.
    """

    stream: Stream
    index: int
    time_s: float
    made_ms: float
    jpeg: bytes
    frozen: bool = False
    lost: bool = False
    waited_ms: int = 0


@dataclass(frozen=True, slots=True)
class SoundMessage:
    """A piece of sound.

    rate_hz: samples per second.  time_s: of the first sample, in the source, seconds.
    made_ms: when that was taken, ms since 1970; 0 for a decoded voice.
    samples: int16, little endian, mono.
    """

    stream: Stream
    rate_hz: int
    time_s: float
    made_ms: float
    samples: bytes


def serialise_message(message: PictureMessage | SoundMessage) -> bytes:
    """The bytes of a message, as above."""
    if isinstance(message, PictureMessage):
        return serialise_picture(message)
    head = message.stream, 0, 0, message.rate_hz, message.time_s, message.made_ms
    return _HEADER.pack(*head) + message.samples


def parse_message(data: bytes) -> PictureMessage | SoundMessage:
    """The message in `data`.  Raises `ProtocolError` if it is none."""
    if not data or data[0] not in (Stream.VOICE, Stream.MICROPHONE):
        return parse_picture(data)
    size = len(data) - _HEADER.size
    if not 0 <= size <= MAX_SOUND_BYTES or size % 2:
        raise ProtocolError(f"sound message of {len(data)} bytes")
    stream, zero, _, rate_hz, time_s, made_ms = _unpacked_header(data)
    if zero or not 1 <= rate_hz <= MAX_RATE_HZ:
        raise ProtocolError(f"sound message of {rate_hz} Hz, flag {zero}")
    samples = bytes(data[_HEADER.size :])
    return SoundMessage(Stream(stream), rate_hz, time_s, made_ms, samples)


def serialise_picture(message: PictureMessage) -> bytes:
    """The bytes of a message, as above."""
    return picture_header(message) + message.jpeg


def picture_header(message: PictureMessage, kind: int = 0) -> bytes:
    """The header of a picture.  kind: added to the byte of its stream."""
    flag = 2 if message.frozen and message.lost else int(message.frozen)
    waited_ms = min(max(message.waited_ms, 0), MAX_WAITED_MS)
    head = message.stream + kind, flag, waited_ms, message.index, message.time_s, message.made_ms
    return _HEADER.pack(*head)


def parse_picture(data: bytes) -> PictureMessage:
    """The message in `data`.  Raises `ProtocolError` if it is none."""
    if not _HEADER.size < len(data) <= _HEADER.size + MAX_JPEG_BYTES:
        raise ProtocolError(f"picture message of {len(data)} bytes")
    stream, flag, waited_ms, index, time_s, made_ms = _unpacked_header(data)
    if stream not in PICTURES or flag > 2:
        raise ProtocolError(f"picture message of stream {stream}, flag {flag}")
    jpeg = bytes(data[_HEADER.size :])
    frozen, lost = flag > 0, flag == 2
    return PictureMessage(Stream(stream), index, time_s, made_ms, jpeg, frozen, lost, waited_ms)


def _unpacked_header(data: bytes) -> tuple[int, int, int, int, float, float]:
    stream, flag, waited_ms, number, time_s, made_ms = _HEADER.unpack_from(data)
    if not isfinite(time_s) or not isfinite(made_ms):
        raise ProtocolError(f"message with the times {time_s} s, {made_ms} ms")
    return stream, flag, waited_ms, number, time_s, made_ms
