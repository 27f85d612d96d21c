"""SFrame on a link: who is heard, and who is not."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.link.messages import (
    NO_SESSION,
    Hello,
    Role,
    is_hello,
    parse_message,
    serialise_message,
    session_in_hello,
)
from protocol.security.packet_protection import (
    MAX_PEERS,
    MAX_UNREADABLE,
    Sender,
    SFrameProtection,
)

KEY, OTHER_KEY = bytes(16), bytes(range(16))
FRAME = b"a frame packet"


@dataclass
class End:
    """One end of a call: what the link does with HELLO messages."""

    sender: Sender
    key: bytes = KEY
    call: str = "anna"
    strangers: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.protection = SFrameProtection(
            self.key, self.call, self.sender, session_in_hello, lambda: self.strangers.append("!")
        )

    def hello(self, echo: bytes = NO_SESSION) -> bytes:
        role = Role.ENCODER if self.sender is Sender.ENCODER else Role.DECODER
        return self.protection.protect(
            serialise_message(Hello(role, self.protection.session, echo))
        )

    def hear(self, packet: bytes) -> bytes | None:
        """What a packet says; the session of a HELLO that echoes ours counts from then on."""
        message = self.protection.unprotect(packet)
        if message is not None and is_hello(message):
            hello = parse_message(message)
            assert isinstance(hello, Hello)
            if hello.echo == self.protection.session:
                self.protection.on_peer(hello.session)
        return message


def introduced(encoder: End, decoder: End) -> None:
    """Both ends exchange their sessions."""
    assert encoder.hear(decoder.hello())
    assert decoder.hear(encoder.hello(decoder.protection.session))
    assert encoder.hear(decoder.hello(encoder.protection.session))


@pytest.fixture
def encoder() -> End:
    return End(Sender.ENCODER)


@pytest.fixture
def decoder() -> End:
    return End(Sender.DECODER)


def test_both_directions_come_through_and_each_packet_once(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    for sender, receiver in ((encoder, decoder), (decoder, encoder)):
        packets = [sender.protection.protect(FRAME + bytes([number])) for number in range(4)]
        for number in (0, 2, 1, 3):
            assert receiver.hear(packets[number]) == FRAME + bytes([number])
        assert [receiver.hear(packet) for packet in packets] == 4 * [None]
        assert not receiver.strangers


def test_a_packet_of_a_call_is_seven_bytes_longer(encoder: End) -> None:
    sizes = {len(encoder.protection.protect(FRAME)) - len(FRAME) for _ in range(300)}
    assert sizes == {5, 6, 7}


def test_a_repetition_is_protected_again(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    first, again = encoder.protection.protect(FRAME), encoder.protection.protect(FRAME)
    assert first != again
    assert decoder.hear(first) == decoder.hear(again) == FRAME


def test_nothing_is_taken_from_a_session_before_it_has_echoed_ours(
    encoder: End, decoder: End
) -> None:
    assert decoder.hear(encoder.hello()) is not None
    assert decoder.hear(encoder.protection.protect(FRAME)) is None
    assert not decoder.strangers


@pytest.mark.parametrize("stranger", [{"key": OTHER_KEY}, {"call": "berta"}])
def test_who_has_no_key_of_this_call_is_not_heard_and_said_once(
    encoder: End, stranger: dict[str, object]
) -> None:
    other = End(Sender.DECODER, **stranger)  # type: ignore[arg-type]
    for _ in range(5):
        assert encoder.hear(other.hello(encoder.protection.session)) is None
    assert encoder.strangers == ["!"]
    assert other.hear(encoder.hello(other.protection.session)) is None
    assert other.strangers == ["!"]


def test_an_end_does_not_take_its_own_packets(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    assert encoder.hear(encoder.protection.protect(FRAME)) is None
    assert encoder.hear(encoder.hello(encoder.protection.session)) is None


def test_an_earlier_call_that_is_replayed_is_not_heard(encoder: End, decoder: End) -> None:
    """Under the same invitation: both ends have been started again."""
    recorded = [encoder.hello(decoder.protection.session)]
    introduced(encoder, decoder)
    recorded += [encoder.protection.protect(FRAME), encoder.hello(decoder.protection.session)]
    answers = [decoder.hello(encoder.protection.session), decoder.protection.protect(FRAME)]
    later_encoder, later_decoder = End(Sender.ENCODER), End(Sender.DECODER)
    for packet in recorded:
        assert later_decoder.hear(packet) != FRAME
    for packet in answers:
        assert later_encoder.hear(packet) != FRAME
    introduced(later_encoder, later_decoder)
    for packet in recorded:
        assert later_decoder.hear(packet) != FRAME
    assert later_decoder.hear(later_encoder.protection.protect(FRAME)) == FRAME


def test_what_a_decoder_told_an_encoder_before_its_restart_is_not_heard(
    encoder: End, decoder: End
) -> None:
    introduced(encoder, decoder)
    recorded = [decoder.protection.protect(FRAME) for _ in range(3)]
    again = End(Sender.ENCODER)
    introduced(again, decoder)
    assert [again.hear(packet) for packet in recorded] == 3 * [None]
    assert again.hear(decoder.protection.protect(FRAME)) == FRAME


def test_what_was_sent_before_a_decoder_joined_is_not_heard(encoder: End, decoder: End) -> None:
    recorded = [encoder.protection.protect(FRAME) for _ in range(3)]
    introduced(encoder, decoder)
    assert [decoder.hear(packet) for packet in recorded] == 3 * [None]
    assert decoder.hear(encoder.protection.protect(FRAME)) == FRAME


def test_a_hello_that_is_replayed_is_ignored_and_moves_nothing(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    hello = encoder.hello(decoder.protection.session)
    assert decoder.hear(hello) is not None
    frame = encoder.protection.protect(FRAME)
    assert decoder.hear(frame) == FRAME
    assert decoder.hear(hello) is None
    assert decoder.hear(frame) is None


def test_every_changed_bit_and_every_truncation_is_refused(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    for packet in (encoder.protection.protect(FRAME), encoder.hello(decoder.protection.session)):
        wrong = [packet[:length] for length in range(len(packet))]
        for bit in range(8 * len(packet)):
            changed = bytearray(packet)
            changed[bit // 8] ^= 1 << bit % 8
            wrong.append(bytes(changed))
        assert {decoder.hear(each) for each in wrong} == {None}
        assert decoder.hear(packet) is not None
    assert decoder.strangers == ["!"]


@given(st.binary(max_size=60))
def test_garbage_is_refused(data: bytes) -> None:
    encoder, decoder = End(Sender.ENCODER), End(Sender.DECODER)
    introduced(encoder, decoder)
    assert encoder.hear(data) is decoder.hear(data) is None


def test_what_cannot_be_read_is_told_at_last(encoder: End) -> None:
    """Packets of a session that has not introduced itself are no matter, unless they go on."""
    other = End(Sender.DECODER, OTHER_KEY)
    for _ in range(MAX_UNREADABLE):
        assert encoder.hear(other.protection.protect(FRAME)) is None
    assert not encoder.strangers
    for _ in range(3):
        assert encoder.hear(other.protection.protect(FRAME)) is None
    assert encoder.strangers == ["!"]


def test_fifty_decoders_are_told_apart(encoder: End) -> None:
    decoders = [End(Sender.DECODER) for _ in range(50)]
    for decoder in decoders:
        introduced(encoder, decoder)
    for number, decoder in enumerate(decoders):
        assert encoder.hear(decoder.protection.protect(bytes([number]))) == bytes([number])
    frame = encoder.protection.protect(FRAME)
    assert [decoder.hear(frame) for decoder in decoders] == 50 * [FRAME]


def test_a_session_that_is_given_up_may_introduce_itself_again(encoder: End, decoder: End) -> None:
    introduced(encoder, decoder)
    for _ in range(MAX_PEERS):
        introduced(encoder, End(Sender.DECODER))
    assert encoder.hear(decoder.protection.protect(FRAME)) is None
    assert encoder.hear(decoder.hello(encoder.protection.session)) is not None
    assert encoder.hear(decoder.protection.protect(FRAME)) == FRAME


def test_sessions_without_an_echo_do_not_push_out_those_that_talk(
    encoder: End, decoder: End
) -> None:
    introduced(encoder, decoder)
    for _ in range(3 * MAX_PEERS):
        assert encoder.hear(End(Sender.DECODER).hello()) is not None
    assert encoder.hear(decoder.protection.protect(FRAME)) == FRAME


def test_a_session_nobody_has_heard_of_is_no_peer(encoder: End, decoder: End) -> None:
    decoder.protection.on_peer(encoder.protection.session)
    assert decoder.hear(encoder.protection.protect(FRAME)) is None


def test_a_hello_without_a_session_is_refused(encoder: End) -> None:
    decoder = SFrameProtection(KEY, "anna", Sender.DECODER, lambda message: b"", lambda: None)
    assert encoder.hear(decoder.protect(b"something else")) is None
