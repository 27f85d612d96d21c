"""Voice blocks: round trips, limits, and only `ProtocolError` of bad bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.limits import VOICES
from protocol.voice.codec2_bits import CODEC2_BITS
from protocol.voice.voice_block import (
    MAX_OFFSET,
    MAX_OPUS_BYTES,
    MAX_SPEECH_FRAMES,
    VoiceBlock,
    join_payload,
    split_payload,
)

SPEAKING = VOICES[1:]
SPEECH = {"700C": bytes.fromhex("123456f0"), "1200": b"abcdeb", "opus": b"speech"}


def speech_frames(voice: str) -> st.SearchStrategy[bytes]:
    """Speech frames of a codec."""
    if voice == "opus":
        return st.binary(min_size=1, max_size=20)
    bits = CODEC2_BITS[voice]
    size = (bits + 7) // 8
    values = st.integers(0, (1 << bits) - 1)
    if voice == "1200":
        values = values.map(lambda value: value & ~1)
    return values.map(lambda value: (value << (8 * size - bits)).to_bytes(size))


@st.composite
def payloads(draw: st.DrawFn) -> tuple[str, VoiceBlock, bytes]:
    """A codec, a voice block and a face."""
    voice = draw(st.sampled_from(SPEAKING))
    frames = draw(st.lists(st.none() | speech_frames(voice), max_size=12))
    while frames and frames[-1] is None:
        frames.pop()
    offset = draw(st.integers(-MAX_OFFSET, MAX_OFFSET)) if frames else 0
    face = draw(st.none() | st.binary(max_size=12))
    return voice, VoiceBlock(tuple(frames), offset, face is not None), face or b""


def block_or_protocol_error(voice: str, payload: bytes) -> None:
    """Fails by any other exception, and if what was split has another encoding."""
    try:
        block, face = split_payload(voice, payload)
    except ProtocolError:
        return
    assert join_payload(voice, block, face) == payload


def samples(voice: str) -> list[bytes]:
    one = SPEECH[voice]
    blocks = [
        (VoiceBlock(), b"face"),
        (VoiceBlock((one,)), b"face"),
        (VoiceBlock((one, None, one), -3), b""),
        (VoiceBlock((one,) * 3, 200, has_face=False), b""),
    ]
    return [join_payload(voice, block, face) for block, face in blocks]


@given(payloads())
def test_what_is_joined_is_what_is_split(sample: tuple[str, VoiceBlock, bytes]) -> None:
    voice, block, face = sample
    assert split_payload(voice, join_payload(voice, block, face)) == (block, face)


@pytest.mark.parametrize("voice", SPEAKING)
def test_every_truncation_is_a_block_or_a_protocol_error(voice: str) -> None:
    for payload in samples(voice):
        for length in range(len(payload)):
            block_or_protocol_error(voice, payload[:length])


@pytest.mark.parametrize("voice", SPEAKING)
def test_every_bit_flip_is_a_block_or_a_protocol_error(voice: str) -> None:
    for payload in samples(voice):
        for bit in range(8 * len(payload)):
            flipped = bytearray(payload)
            flipped[bit // 8] ^= 1 << bit % 8
            block_or_protocol_error(voice, bytes(flipped))


def test_bytes_are_those_of_the_page() -> None:
    block = VoiceBlock((SPEECH["700C"], None, SPEECH["700C"]), -2)
    assert join_payload("700C", block, b"\x80").hex() == "1b03a0123456f123456f80"
    spoken = VoiceBlock((bytes.fromhex("c0ffee123456"),))
    assert join_payload("1200", spoken, b"\x80").hex() == "085ebd3e02345680"
    assert join_payload("1200", VoiceBlock(), b"\x80").hex() == "0080"
    assert join_payload("opus", VoiceBlock((b"ab",), has_face=False), b"").hex() == "0c026162"


@pytest.mark.parametrize(
    ("voice", "payload", "message"),
    [
        ("1200", "", "voice"),
        ("1200", "8010", "256 speech frames"),
        ("opus", "0a00", "displaced by 0"),
        ("opus", "0ab2ea010161", "limit 15000"),
        ("opus", "02020161", "a voice block without frames is displaced"),
        ("opus", "0980", "a mask without silent frames"),
        ("opus", "09a0", "are not 0"),
        ("opus", "1180", "cut off"),
        ("opus", "1900", "last speech frame is silent"),
        ("opus", "0800", "Opus frame of no bytes"),
        ("opus", "080261", "cut off"),
        ("700C", "08123456f1", "are not 0"),
        ("1200", "0861", "cut off"),
        ("1200", "0480", "1 bytes after a block without a face"),
    ],
)
def test_bad_bytes_are_named(voice: str, payload: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        split_payload(voice, bytes.fromhex(payload))


@pytest.mark.parametrize(
    ("frames", "offset", "message"),
    [
        ((b"a",) * (MAX_SPEECH_FRAMES + 1), 0, "256 speech frames"),
        ((b"a",), MAX_OFFSET + 1, "displaced by 15001"),
        ((b"a",), -MAX_OFFSET - 1, "displaced by -15001"),
        ((b"a", None), 0, "last speech frame is silent"),
        ((), 1, "without frames is displaced"),
    ],
)
def test_blocks_beyond_a_limit_are_none(
    frames: tuple[bytes | None, ...], offset: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        VoiceBlock(frames, offset)


@pytest.mark.parametrize(
    ("voice", "frame", "message"),
    [
        ("700C", b"abc", "not of 28 bits"),
        ("700C", b"abca", "not of 28 bits"),
        ("1200", b"abcdefg", "not of 48 bits"),
        ("1200", b"abcdec", "spare bit of speech frame 616263646563"),
        ("opus", b"", "0 bytes"),
        ("opus", bytes(MAX_OPUS_BYTES + 1), "256 bytes"),
        ("off", b"a", "voice is 'off'"),
        ("x", b"a", "voice is 'x'"),
    ],
)
def test_frames_of_another_codec_are_a_value_error(voice: str, frame: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        join_payload(voice, VoiceBlock((frame,)), b"")


def test_a_block_without_a_face_has_none() -> None:
    with pytest.raises(ValueError, match="without a face has 4 bytes"):
        join_payload("opus", VoiceBlock(has_face=False), b"face")


def test_the_largest_block_comes_back() -> None:
    block = VoiceBlock((SPEECH["1200"],) * MAX_SPEECH_FRAMES, MAX_OFFSET)
    assert split_payload("1200", join_payload("1200", block, b"")) == (block, b"")
