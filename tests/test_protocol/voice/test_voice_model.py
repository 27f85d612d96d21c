"""The codec of the voice in model packets: a key and a format of its own."""

from dataclasses import replace

import msgpack  # type: ignore[import-untyped]
import pytest
from packets import CALL, GOLDEN, MODEL

from protocol.call_parameters import PROFILES
from protocol.errors import ProtocolError
from protocol.limits import VOICE_NUMBERS, VOICES
from protocol.model_packet import VOICE_FORMAT
from protocol.packets import parse_packet, serialise


def with_voice_field(value: object) -> bytes:
    """A model packet with another value of key v."""
    data = serialise(GOLDEN["model_voice"])
    fields = msgpack.unpackb(data[2:], use_list=False) | {"v": value}
    packed: bytes = msgpack.packb(fields, use_single_float=True)
    return data[:2] + packed


@pytest.mark.parametrize("voice", VOICES[1:])
@pytest.mark.parametrize("profile", PROFILES)
def test_a_model_with_a_voice_has_a_format_of_its_own(profile: str, voice: str) -> None:
    model = replace(MODEL, call=replace(CALL, profile=profile, voice=voice))
    data = serialise(model)
    assert data[1] == VOICE_FORMAT and parse_packet(data) == model
    assert serialise(MODEL)[1] != VOICE_FORMAT


@pytest.mark.parametrize("value", [max(VOICE_NUMBERS.values()) + 1, -1, True, "x"])
def test_a_voice_out_of_bounds_is_named(value: object) -> None:
    with pytest.raises(ProtocolError, match="voice"):
        parse_packet(with_voice_field(value))


def test_the_number_of_1200_without_prefix_codes_is_refused() -> None:
    with pytest.raises(ProtocolError, match="voice is 2, this program reads 0, 1, 3, 4"):
        parse_packet(with_voice_field(2))


def test_no_voice_is_said_in_the_older_formats() -> None:
    with pytest.raises(ProtocolError, match="one encoding"):
        parse_packet(with_voice_field(0))
    with pytest.raises(ValueError, match="voice is 'x'"):
        replace(CALL, voice="x")
