"""What the decoder's end of a link holds and names at most."""

from dataclasses import replace
from typing import Any

import pytest
from deliveries import DECODER, ENCODER, LAYER, added, hello, pieces
from packets import MODEL

from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.link.delivery.item_assembly import MAX_AHEAD, MAX_HELD_BYTES, ItemAssembly
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.messages import (
    MAX_HOLDINGS,
    MAX_NUMBER,
    NO_SESSION,
    PIECE_BYTES,
    Bye,
    Channel,
    Hello,
    Holding,
    Piece,
    Report,
    Role,
    Span,
    parse_message,
    peer_id,
    serialise_message,
)
from protocol.packets import ControlKind, ControlPacket, FramePacket, LayerPacket, serialise


def test_memory_and_reports_are_bounded() -> None:
    items = ItemAssembly()
    with pytest.raises(ProtocolError, match="beyond"):
        items.add(pieces(MAX_AHEAD, LAYER)[0])
    for number in range(MAX_HOLDINGS + 9):
        items.add(pieces(number, LAYER)[0])
    assert len(items.holdings()) == MAX_HOLDINGS
    longer = serialise(LayerPacket(0, 0, bytes(3 * PIECE_BYTES)))
    with pytest.raises(ProtocolError, match="more than"):
        for number in range(MAX_HELD_BYTES // PIECE_BYTES):
            added(items, *pieces(number, longer)[:2])


def test_items_that_wait_for_one_before_them_take_bounded_memory_and_come_with_it() -> None:
    items, held = ItemAssembly(), list[bytes]()
    with pytest.raises(ProtocolError, match="more than"):
        while len(held) <= MAX_HELD_BYTES // len(LAYER):
            added(items, *pieces(len(held) + 1, LAYER, Channel.ORDERED))
            held.append(LAYER)
    assert added(items, *pieces(0, LAYER, Channel.ORDERED)) == [LAYER, *held]
    assert added(items, *pieces(len(held) + 1, LAYER, Channel.ORDERED)) == [LAYER]


def test_items_that_have_been_given_out_take_no_memory() -> None:
    items = ItemAssembly()
    for number in range(1, 2 + MAX_HELD_BYTES // len(LAYER)):
        assert added(items, *pieces(number, LAYER)) == [LAYER]


def test_a_decoder_reports_whatever_numbers_its_encoder_has_named() -> None:
    last = Span(MAX_NUMBER - 1, MAX_NUMBER)
    end = DeliveryReceiver(DECODER, lambda session: None)
    end.receive(
        hello(Role.ENCODER, ENCODER, echo=DECODER, frames=MAX_NUMBER, ordered=last, unordered=last),
        0.0,
    )
    for step in range(3):
        number = (MAX_NUMBER + 30 * step) % 64
        end.receive(serialise(FramePacket(number, bytes(9))), 0.3 * step)
    control = serialise(ControlPacket(0, ControlKind.FACE_LOST, 9))
    for item in (MAX_NUMBER - 1, MAX_NUMBER):
        end.receive(serialise_message(Piece(Channel.ORDERED, item, 0, len(control), 0, control)), 1)
    frame = serialise(FramePacket(63, bytes(9)))
    passed = Piece(Channel.UNORDERED, MAX_NUMBER, MAX_NUMBER, len(frame), 0, frame)
    end.receive(serialise_message(passed), 1.0)
    reports = [parse_message(data) for data in end.payloads(1.5)]
    (report,) = [each for each in reports if isinstance(each, Report)]
    assert report.ordered == report.frames == MAX_NUMBER + 1


@pytest.mark.parametrize("field", ["frames", "ordered", "item", "number"])
def test_higher_numbers_are_refused(field: str) -> None:
    beyond = encode_varint(MAX_NUMBER + 1)
    greeting = serialise_message(Hello(Role.ENCODER, ENCODER, DECODER))
    piece = serialise_message(Piece(Channel.ORDERED, 0, 0, 1, 0, b"x"))
    data = {
        "frames": greeting[:-5] + beyond + bytes(4),
        "ordered": greeting[:-4] + beyond + bytes(3),
        "item": piece[:2] + beyond + piece[3:],
        "number": piece[:3] + beyond + piece[4:],
    }[field]
    with pytest.raises(ProtocolError, match="2147483648"):
        parse_message(data)


def test_what_is_said_to_another_decoder_is_not_answered() -> None:
    receiver = DeliveryReceiver(DECODER, lambda session: None)
    receiver.receive(hello(Role.ENCODER, ENCODER, echo=b"decoder2", asks=True), 0.0)
    questions = [parse_message(payload) for payload in receiver.payloads(0.0)]
    # Its own question alone: no answer to that.
    assert [(each.asks, each.answers) for each in questions if isinstance(each, Hello)] == [
        (True, 0)
    ]
    receiver.receive(hello(Role.ENCODER, ENCODER, echo=DECODER), 0.01)
    receiver.payloads(0.02)
    receiver.receive(hello(Role.ENCODER, ENCODER, echo=b"decoder2", asks=True), 0.03)
    assert not receiver.payloads(0.03)


def test_many_decoders_are_asked_less_often() -> None:
    def questions(decoders: int) -> int:
        sender = DeliverySender(ENCODER, False, lambda session: None)
        for number in range(decoders):
            sender.receive(hello(Role.DECODER, number.to_bytes(8, "little"), echo=ENCODER), 0.0)
        ticks = [sender.payloads(0.05 * tick) for tick in range(40)]
        said = [parse_message(payload) for tick in ticks for payload in tick]
        return sum(isinstance(each, Hello) and each.echo == NO_SESSION for each in said)

    # None of them has reported: two seconds of questions, and of 200 answers a second.
    assert questions(10) == 8
    assert questions(400) == 1


def test_decoders_whose_reports_look_alike_both_get_all() -> None:
    heard = list[bytes]()
    sender, now_s = DeliverySender(ENCODER, False, heard.append), 0.0
    first, second = b"decoder1", b"deloader"
    assert peer_id(first) == peer_id(second)
    for session in (first, second, second):
        sender.receive(hello(Role.DECODER, session, echo=ENCODER), now_s)
    assert heard == [first, second] and sender.peers == {first, second}
    sender.send(serialise(replace(MODEL, texture=bytes(3 * PIECE_BYTES - 400))))

    def sent(seconds: float) -> list[Piece]:
        nonlocal now_s
        now_s += seconds
        said = map(parse_message, sender.payloads(now_s))
        return [each for each in said if isinstance(each, Piece)]

    def report(**fields: Any) -> None:
        sender.receive(serialise_message(Report(peer_id(first), **fields)), now_s)

    report()
    assert [each.index for each in sent(0.1)] == [0, 1, 2]
    report(unordered=1)
    assert not sent(1.0)
    # The other one has lost a piece, and says so when the first has all.
    report(holdings=(Holding(Channel.UNORDERED, 0, 0b101),))
    assert [each.index for each in sent(0.1)] == [1]
    report(unordered=1)
    assert not sent(1.0)
    # Who leaves may be either of them: the other one says again that it is there.
    sender.receive(serialise_message(Bye(Role.DECODER, peer_id(first))), now_s)
    sender.receive(hello(Role.DECODER, first, echo=ENCODER), now_s)
    assert sender.peers == {first}
