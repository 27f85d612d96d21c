"""Voice blocks: the speech frames of 40 ms that a frame packet carries before its face.

In a call with a voice the payload of every frame packet is a voice block and then the face.  Silent
frames take no bytes.  The format is specified in docs/format.md.
"""

from dataclasses import dataclass

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import VOICES
from protocol.voice.bit_string import BitReader, BitWriter
from protocol.voice.codec2_bits import put_frame, take_frame

SPEECH_FRAMES_PER_SECOND = 25
# Modes of Codec2 by the name of the voice, bits a second, and the rate of its samples.
CODEC2_MODES = {"700C": 700, "1200": 1200}
CODEC2_RATE_HZ = 8000
MAX_SPEECH_FRAMES = 255
# Most that a block may be displaced: ten minutes.
MAX_OFFSET = 600 * SPEECH_FRAMES_PER_SECOND
MAX_OPUS_BYTES = 255

_MASKED, _PLACED, _FACELESS, _COUNT = 1, 2, 4, 8


@dataclass(frozen=True, slots=True)
class VoiceBlock:
    """Consecutive speech frames; None: the frame is silent.  The last one is not.

    offset: number of the first one less the expected one, see `PacketClock`; 0 without frames.
    has_face: whether the face follows; without, the packet shows nothing.
    """

    frames: tuple[bytes | None, ...] = ()
    offset: int = 0
    has_face: bool = True

    def __post_init__(self) -> None:
        if len(self.frames) > MAX_SPEECH_FRAMES:
            raise ValueError(f"{len(self.frames)} speech frames, limit {MAX_SPEECH_FRAMES}")
        if abs(self.offset) > MAX_OFFSET:
            raise ValueError(f"voice is displaced by {self.offset} frames, limit {MAX_OFFSET}")
        if self.frames and self.frames[-1] is None:
            raise ValueError("the last speech frame is silent")
        if self.offset and not self.frames:
            raise ValueError("a voice block without frames is displaced")


def join_payload(voice: str, block: VoiceBlock, face: bytes) -> bytes:
    """The payload of a frame packet.

    voice: one of `VOICES`, not "off".  face: as the profile specifies; empty if the block has none.
    Raises `ValueError` if a speech frame is not one of the codec.
    """
    _check_voice(voice)
    if face and not block.has_face:
        raise ValueError(f"a packet without a face has {len(face)} bytes of it")
    is_masked = None in block.frames
    head = len(block.frames) * _COUNT + _MASKED * is_masked
    head += _PLACED * bool(block.offset) + _FACELESS * (not block.has_face)
    data = encode_varint(head)
    if block.offset:
        data += encode_varint(_zigzag(block.offset))
    if is_masked:
        data += _mask([frame is not None for frame in block.frames])
    speech = [frame for frame in block.frames if frame is not None]
    return data + serialise_frames(voice, speech) + face


def split_payload(voice: str, payload: bytes) -> tuple[VoiceBlock, bytes]:
    """Voice block and face of a frame packet's payload; the inverse of `join_payload`.

    Raises `ProtocolError` if the block is not valid.
    """
    _check_voice(voice)
    try:
        return _split(voice, payload)
    except ValueError as error:
        raise ProtocolError(f"voice: {error}") from error


def _split(voice: str, payload: bytes) -> tuple[VoiceBlock, bytes]:
    head, position = decode_varint(payload)
    count = head // _COUNT
    if count > MAX_SPEECH_FRAMES:
        raise ValueError(f"{count} speech frames, limit {MAX_SPEECH_FRAMES}")
    offset = 0
    if head & _PLACED:
        code, length = decode_varint(payload[position:])
        position += length
        offset = _unzigzag(code)
        if not offset:
            raise ValueError("displaced by 0 frames")
    present = [1] * count
    if head & _MASKED:
        mask = BitReader(payload, position)
        present = [mask.take(1) for _ in range(count)]
        position = mask.finish()
        if all(present):
            raise ValueError("a mask without silent frames")
    speech, position = _parse_frames(voice, payload, position, sum(present))
    frames = iter(speech)
    block = VoiceBlock(
        tuple(next(frames) if each else None for each in present), offset, not head & _FACELESS
    )
    if len(payload) > position and not block.has_face:
        raise ValueError(f"{len(payload) - position} bytes after a block without a face")
    return block, payload[position:]


def serialise_frames(voice: str, speech: list[bytes]) -> bytes:
    """Spoken frames of a codec as they stand in a voice block.

    Raises `ValueError` if one is not of the codec.
    """
    if voice not in CODEC2_MODES:
        for frame in speech:
            if not 1 <= len(frame) <= MAX_OPUS_BYTES:
                raise ValueError(f"Opus frame has {len(frame)} bytes, limit {MAX_OPUS_BYTES}")
        return b"".join(bytes([len(frame)]) + frame for frame in speech)
    writer = BitWriter()
    for frame in speech:
        put_frame(voice, frame, writer)
    return writer.to_bytes()


def _parse_frames(voice: str, payload: bytes, position: int, count: int) -> tuple[list[bytes], int]:
    """`count` speech frames from `position` on, and where they end."""
    if voice in CODEC2_MODES:
        reader = BitReader(payload, position)
        return [take_frame(voice, reader) for _ in range(count)], reader.finish()
    frames = []
    for _ in range(count):
        (length,) = _take(payload, position, 1)
        if not length:
            raise ValueError("Opus frame of no bytes")
        frames.append(_take(payload, position + 1, length))
        position += 1 + length
    return frames, position


def _mask(present: list[bool]) -> bytes:
    writer = BitWriter()
    for is_spoken in present:
        writer.put(is_spoken, 1)
    return writer.to_bytes()


def _take(payload: bytes, position: int, size: int) -> bytes:
    taken = payload[position : position + size]
    if len(taken) != size:
        raise ValueError("cut off")
    return taken


def _zigzag(value: int) -> int:
    return 2 * value if value >= 0 else -2 * value - 1


def _unzigzag(code: int) -> int:
    return code // 2 if code % 2 == 0 else -(code + 1) // 2


def _check_voice(voice: str) -> None:
    if voice not in VOICES or voice == "off":
        raise ValueError(f"voice is {voice!r}, expected one of {VOICES[1:]}")
