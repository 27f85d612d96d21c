"""Messages of a link: one encoding, and one error for all other bytes."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.link.link_protection import PlainProtection
from protocol.link.messages import (
    PIECE_BYTES,
    Bye,
    Channel,
    Hello,
    Holding,
    Message,
    Piece,
    Report,
    Role,
    Span,
    is_hello,
    is_message,
    parse_message,
    piece_count,
    serialise_message,
    session_in_hello,
)
from protocol.packets import ControlKind, ControlPacket, FramePacket, serialise

FOLDER = Path(__file__).parents[2] / "vectors"
OURS, THEIRS = bytes(range(8)), bytes(range(8, 16))
MESSAGES: list[Message] = [
    Hello(Role.DECODER, OURS),
    Hello(Role.ENCODER, OURS, THEIRS, True, False, 7, 9, 300, Span(2, 5), Span(1, 200), 3),
    Report(0x0809),
    Report(9, 64, 301, 4, 2, (Holding(Channel.UNORDERED, 2, 0b1011),), (290, 295, 299)),
    Piece(Channel.ORDERED, 3, 77, 5, 0, b"abcde"),
    Piece(Channel.UNORDERED, 300, 0, PIECE_BYTES + 1, 1, b"x"),
    Piece(Channel.UNORDERED, 4, 0, 0, 0, b""),
    Bye(Role.ENCODER, 0x0001),
]


VECTORS: dict[str, Message] = {
    "link_hello": Hello(
        Role.ENCODER, b"encoder1", b"decoder1", True, False, 7, 3, 300, Span(2, 3), Span(0, 5)
    ),
    "link_report": Report(
        0x6465, 13, 300, 3, 4, (Holding(Channel.UNORDERED, 4, 0b101),), (295, 297)
    ),
    "link_piece": Piece(Channel.UNORDERED, 4, 310, 515, 1, b"abc"),
}


@pytest.mark.parametrize("name", VECTORS)
def test_messages_are_those_of_the_format(name: str) -> None:
    data = bytes.fromhex((FOLDER / f"{name}.hex").read_text())
    assert parse_message(data) == VECTORS[name] and serialise_message(VECTORS[name]) == data


def test_the_checksum_is_that_of_the_format() -> None:
    data = bytes.fromhex((FOLDER / "link_bye.hex").read_text())
    guard = PlainProtection(b"encoder1", is_encoder=True)
    bye = serialise_message(Bye(Role.DECODER, 0x6465))
    assert guard.unprotect(data) == bye and guard.protect(bye) == data


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_has_one_encoding(message: Message) -> None:
    data = serialise_message(message)
    assert is_message(data) and parse_message(data) == message
    assert is_hello(data) == isinstance(message, Hello)


@pytest.mark.parametrize("message", MESSAGES)
def test_a_hello_tells_its_session_and_nothing_else_does(message: Message) -> None:
    data = serialise_message(message)
    session = message.session if isinstance(message, Hello) else None
    assert session_in_hello(data) == session and session_in_hello(data[:10]) is None


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_that_is_cut_or_changed_is_another_one_or_an_error(message: Message) -> None:
    data = serialise_message(message)
    changed = [data[:length] for length in range(len(data))]
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        changed.append(bytes(flipped))
    for other in changed:
        try:
            found = parse_message(other)
        except ProtocolError:
            continue
        assert found != message and serialise_message(found) == other


@given(st.binary(max_size=80))
def test_any_bytes_are_a_message_or_an_error(rest: bytes) -> None:
    for kind in range(16, 22):
        data = bytes([0x80, kind]) + rest
        try:
            assert serialise_message(parse_message(data)) == data
        except ProtocolError as error:
            assert str(error)


def test_packets_of_a_call_are_no_messages() -> None:
    for packet in (FramePacket(0, b"\x10abc"), ControlPacket(0, ControlKind.END, 100)):
        assert not is_message(serialise(packet))


@pytest.mark.parametrize("total", [1, PIECE_BYTES, PIECE_BYTES + 1, 10_000])
def test_pieces_take_the_whole_packet(total: int) -> None:
    assert (piece_count(total) - 1) * PIECE_BYTES < total <= piece_count(total) * PIECE_BYTES


def test_a_piece_of_the_wrong_size_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 5"):
        Piece(Channel.ORDERED, 0, 0, 5, 0, b"abc")


def both_ends() -> tuple[PlainProtection, PlainProtection]:
    encoder = PlainProtection(OURS, is_encoder=True)
    decoder = PlainProtection(THEIRS, is_encoder=False)
    decoder.on_peer(OURS)
    return encoder, decoder


def test_a_checksum_notices_every_changed_bit() -> None:
    encoder, decoder = both_ends()
    for data in (b"\x05some frame packet", serialise_message(MESSAGES[1])):
        sent = encoder.protect(data)
        assert len(sent) == len(data) + 2 and decoder.unprotect(sent) == data
        for bit in range(8 * len(sent)):
            flipped = bytearray(sent)
            flipped[bit // 8] ^= 1 << bit % 8
            assert decoder.unprotect(bytes(flipped)) is None


def test_a_packet_of_another_session_is_refused_and_its_hello_is_read() -> None:
    _, decoder = both_ends()
    restarted = PlainProtection(b"restart!", is_encoder=True)
    assert decoder.unprotect(restarted.protect(b"\x05frame")) is None
    hello = serialise_message(Hello(Role.ENCODER, b"restart!"))
    assert decoder.unprotect(restarted.protect(hello)) == hello
    decoder.on_peer(b"restart!")
    assert decoder.unprotect(restarted.protect(b"\x05frame")) == b"\x05frame"


def test_too_few_bytes_are_refused() -> None:
    encoder, _ = both_ends()
    assert [encoder.unprotect(bytes(length)) for length in range(3)] == [None, None, None]
