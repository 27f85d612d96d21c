"""The binary messages between page and server."""

from dataclasses import replace

import pytest

from protocol.errors import ProtocolError
from risorius.call_page.messages import (
    MAX_JPEG_BYTES,
    PictureMessage,
    SoundMessage,
    Stream,
    parse_message,
    parse_picture,
    serialise_message,
    serialise_picture,
)

MESSAGE = PictureMessage(Stream.SELF, 70000, 2333.5, 1.8e12, b"\xff\xd8jpeg", frozen=True)


SOUND = SoundMessage(Stream.MICROPHONE, 48000, 12.25, 1.8e12, b"\1\2\3\4")


@pytest.mark.parametrize("message", [MESSAGE, replace(MESSAGE, lost=True), SOUND])
def test_pictures_and_sound_come_back_as_they_were(message: PictureMessage | SoundMessage) -> None:
    assert parse_message(serialise_message(message)) == message


def test_what_is_no_sound_is_refused() -> None:
    data = serialise_message(SOUND)
    no_rate = data[:4] + bytes(4) + data[8:]
    for damaged in (data[:1], data[:23], data[:25], data[:1] + b"\x01" + data[2:], no_rate):
        with pytest.raises(ProtocolError):
            parse_message(damaged)


def test_a_message_comes_back_as_it_was() -> None:
    assert parse_picture(serialise_picture(MESSAGE)) == MESSAGE


def test_the_header_is_as_described() -> None:
    data = serialise_picture(MESSAGE)
    assert data[:8].hex() == "0201000070110100" and data[24:] == MESSAGE.jpeg


def test_what_is_no_message_is_refused() -> None:
    data = serialise_picture(MESSAGE)
    too_long = serialise_picture(replace(MESSAGE, jpeg=bytes(MAX_JPEG_BYTES + 1)))
    for damaged in (b"", data[:24], b"\x09" + data[1:], data[:1] + b"\x03" + data[2:], too_long):
        with pytest.raises(ProtocolError):
            parse_picture(damaged)


@pytest.mark.parametrize("message", [MESSAGE, SOUND])
@pytest.mark.parametrize("time", [float("nan"), float("inf"), -float("inf")])
def test_times_are_numbers(message: PictureMessage | SoundMessage, time: float) -> None:
    for damaged in (replace(message, time_s=time), replace(message, made_ms=time)):
        with pytest.raises(ProtocolError):
            parse_message(serialise_message(damaged))
