"""What the ends of a link do with what is not meant for them, or comes twice."""

from dataclasses import replace

import pytest
from deliveries import DECODER, ENCODER, LAYER, added, hello, pieces
from packets import MODEL

from protocol.errors import ProtocolError
from protocol.link.delivery.frame_numbers import FrameNumbers
from protocol.link.delivery.item_assembly import ItemAssembly
from protocol.link.delivery.item_store import ItemStore
from protocol.link.delivery.piece_window import WHOLE_PIECE_BYTES, PieceWindow, Sent
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import (
    LINGER_S,
    MAX_BEHIND,
    STALLED_S,
    DeliverySender,
    FrameCopies,
)
from protocol.link.messages import (
    PIECE_BYTES,
    Bye,
    Channel,
    Hello,
    Holding,
    Report,
    Role,
    Span,
    parse_message,
    peer_id,
    serialise_message,
)
from protocol.packets import ControlKind, ControlPacket, FramePacket, LayerPacket, serialise

END = serialise(ControlPacket(0, ControlKind.END, 9))


def receiver(frames: int = 0) -> DeliveryReceiver:
    """One that has met its encoder at time 0."""
    end = DeliveryReceiver(DECODER, lambda session: None)
    end.receive(hello(Role.ENCODER, ENCODER, echo=DECODER, frames=frames), 0.0)
    return end


def sender() -> DeliverySender:
    """One that has met its decoder at time 0."""
    end = DeliverySender(ENCODER, False, lambda session: None)
    end.receive(hello(Role.DECODER, DECODER, echo=ENCODER), 0.0)
    return end


def test_an_item_is_put_together_once_whatever_comes_twice() -> None:
    items, both = ItemAssembly(), pieces(0, LAYER)
    assert added(items, both[0], both[0], both[1], *both) == [LAYER]
    assert items.below(Channel.UNORDERED) == 1 and items.holdings() == ()


def test_an_item_that_has_changed_is_begun_anew() -> None:
    items, longer = ItemAssembly(), LAYER + b"more"
    assert added(items, pieces(0, LAYER)[0], *pieces(0, longer)) == [longer]


def test_an_item_that_is_there_is_held_whole_when_it_gets_longer() -> None:
    items, longer = ItemAssembly(), LAYER + PIECE_BYTES * b"x"
    assert added(items, *pieces(1, LAYER)) == [LAYER]
    assert added(items, pieces(1, longer)[0]) == []
    whole = (1 << len(pieces(1, longer))) - 1
    assert items.holdings() == (Holding(Channel.UNORDERED, 1, whole),)


def test_what_is_not_needed_any_more_is_dropped() -> None:
    items = ItemAssembly()
    assert added(items, pieces(0, LAYER)[0], *pieces(2, LAYER)) == [LAYER]
    items.extend(Channel.UNORDERED, Span(2, 3))
    assert items.below(Channel.UNORDERED) == 3
    items.extend(Channel.UNORDERED, Span(1, 3))
    items.extend(Channel.ORDERED, Span(5, 6))
    assert items.below(Channel.UNORDERED) == 3 and items.below(Channel.ORDERED) == 0
    assert added(items, *pieces(2, LAYER), *pieces(3, b"")) == []
    assert items.below(Channel.UNORDERED) == 4


def test_ordered_items_wait_for_those_before() -> None:
    items = ItemAssembly()
    one, two = (serialise(ControlPacket(0, ControlKind.FACE_LOST, n)) for n in (1, 2))
    assert added(items, *pieces(1, two, Channel.ORDERED)) == []
    assert added(items, *pieces(0, one, Channel.ORDERED)) == [one, two]


def test_a_model_in_use_replaces_the_one_before_and_keeps_its_layers() -> None:
    store = ItemStore(keeps_all=False)
    later = replace(MODEL, sequence=2, version=1, version_count=2)
    layer = serialise(LayerPacket(1, 0, b"piece"))
    for packet in (serialise(replace(MODEL, sequence=0)), LAYER, serialise(later), layer):
        store.add(packet, 0)
    for number in range(3):
        store.on_frame(serialise(FramePacket(number, bytes(9))))
    assert store.span(Channel.UNORDERED) == Span(2, 4)
    assert store.get(Channel.UNORDERED, 3).packet == layer
    assert store.piece((Channel.UNORDERED, 0, 0)).total == 0


def test_a_decoder_takes_packets_of_its_encoder_alone() -> None:
    """And none before it knows which that is."""
    end = DeliveryReceiver(DECODER, lambda session: None)
    frame = serialise(FramePacket(0, bytes(9)))
    assert end.receive(frame, 0.0) == [] and end.heard_s is None
    assert end.receive(serialise_message(pieces(0, LAYER)[0]), 0.0) == []
    assert end.receive(hello(Role.DECODER, b"somebody", echo=DECODER), 0.0) == []
    assert end.bye() is None and not end.has_left and not end.is_active(0.0)
    with pytest.raises(ProtocolError, match="neither"):
        end.receive(LAYER, 0.0)


def test_a_decoder_asks_again_on_a_new_link_and_knows_when_its_encoder_leaves() -> None:
    end = receiver()
    assert parse_message(end.hello(0.0)).__class__ is Hello
    end.payloads(5.0)
    assert end.payloads(5.1) == []
    end.on_new_link()
    assert end.payloads(5.2)
    end.receive(serialise_message(Bye(Role.ENCODER, peer_id(ENCODER))), 6.0)
    assert end.has_left and end.heard_s == 0.0


def test_a_decoder_that_has_the_end_says_good_bye_until_it_is_heard() -> None:
    end = receiver()
    model = serialise(replace(MODEL, sequence=0))
    for piece in (*pieces(0, model), *pieces(0, END, Channel.ORDERED)):
        end.receive(serialise_message(piece), 1.0)
    assert [arrival.data for arrival in end.due(1.0)] == [END]
    farewell = end.bye()
    assert end.payloads(1.0) == [farewell] and end.payloads(9.0) == []
    end.receive(hello(Role.ENCODER, ENCODER, echo=DECODER, asks=True), 9.0)
    assert end.payloads(9.0) == [farewell]


def test_an_end_without_a_model_is_given_out_in_time() -> None:
    end = receiver()
    end.receive(serialise_message(pieces(0, END, Channel.ORDERED)[0]), 1.0)
    assert end.due(1.0) == []
    assert [arrival.data for arrival in end.due(20.0)] == [END]


def test_an_encoder_stays_while_more_gets_there_and_for_nobody_who_is_gone() -> None:
    end, report = sender(), Report(peer_id(DECODER))
    end.send(END)
    end.receive(serialise_message(report), 10.0)
    end.payloads(10.0)
    assert end.is_awaited(10.0, 10.0 + STALLED_S - 0.1), "its word may be held up, too"
    assert not end.is_awaited(20.0, 10.0 + STALLED_S), "it is not heard any more"
    end.receive(serialise_message(report), 10.0 + STALLED_S)
    assert not end.is_awaited(10.0, 10.0 + STALLED_S), "nothing more has got there"
    end.receive(serialise_message(replace(report, ordered=1)), 20.0)
    assert end.is_awaited(10.0, 20.0 + LINGER_S - 0.1), "it may not have said all"
    assert not end.is_awaited(10.0, 20.0 + LINGER_S)
    end.receive(serialise_message(Bye(Role.DECODER, peer_id(DECODER))), 21.0)
    assert not end.is_awaited(10.0, 21.0)


def test_an_encoder_knows_who_is_there() -> None:
    end = sender()
    assert end.peers == {DECODER} and not end.is_measured
    end.receive(hello(Role.ENCODER, b"another1", echo=ENCODER), 0.0)
    end.receive(serialise_message(Bye(Role.ENCODER, peer_id(DECODER))), 0.0)
    end.receive(serialise_message(Report(0x1111)), 0.0)
    end.receive(serialise_message(Bye(Role.DECODER, 0x1111)), 0.0)
    assert end.peers == {DECODER}
    end.forget_peers()
    assert end.peers == frozenset() and end.heard_s == 0.0
    end.receive(hello(Role.DECODER, DECODER, echo=ENCODER), 1.0)
    end.receive(hello(Role.DECODER, b"2decoder", echo=ENCODER), 1.0)
    for session in (DECODER, b"2decoder"):
        end.receive(serialise_message(Bye(Role.DECODER, peer_id(session))), 2.0)
    end.receive(hello(Role.DECODER, b"2decoder", echo=ENCODER), 2.1)
    assert end.peers == frozenset() and end.heard_s == float("-inf")


def test_an_encoder_asks_at_once_on_a_new_link_and_says_good_bye() -> None:
    end = DeliverySender(ENCODER, False, lambda session: None)
    assert end.payloads(0.0) and not end.payloads(0.1)
    end.on_new_link()
    assert end.payloads(0.1)
    assert parse_message(end.bye()) == Bye(Role.ENCODER, peer_id(ENCODER))


def test_an_encoder_takes_no_pieces_and_believes_no_report_of_what_it_has_not_sent() -> None:
    end = sender()
    end.receive(serialise_message(pieces(0, LAYER)[0]), 0.0)
    unsent = (Holding(Channel.UNORDERED, 7, 1),)
    end.receive(serialise_message(Report(peer_id(DECODER), holdings=unsent)), 0.1)
    assert end.peers == {DECODER} and end.quality.rate_bps is None


def test_a_link_is_not_measured_by_half_a_pair() -> None:
    end, now_s = sender(), 0.0
    for answers_all in (False, True):
        asked = list[Hello]()
        while not any(each.padding for each in asked):
            now_s += 0.3
            found = [parse_message(data) for data in end.payloads(now_s)]
            asked = [each for each in found if isinstance(each, Hello)]
            for each in asked:
                if not each.padding and (answers_all or len(asked) == 1):
                    answer = hello(Role.DECODER, DECODER, echo=ENCODER, answers=each.nonce)
                    end.receive(answer, now_s + 0.1)
        answer = hello(Role.DECODER, DECODER, echo=ENCODER, answers=asked[-1].nonce)
        end.receive(answer, now_s + 0.2)
        assert (end.quality.rate_bps is not None) is answers_all
    assert end.quality.rate_bps == pytest.approx(32_000)


def test_a_link_whose_rate_is_told_is_not_measured() -> None:
    end, now_s = DeliverySender(ENCODER, False, lambda session: None, 8000), 0.0
    end.receive(hello(Role.DECODER, DECODER, echo=ENCODER), now_s)
    assert end.is_measured and end.quality.rate_bps == 8000
    for _ in range(30):
        now_s += 0.3
        asked = [parse_message(data) for data in end.payloads(now_s)]
        for each in asked:
            assert isinstance(each, Hello) and not each.padding
            end.receive(hello(Role.DECODER, DECODER, echo=ENCODER, answers=each.nonce), now_s + 0.1)
    assert end.quality.round_trip_s == pytest.approx(0.1)


def test_the_window_grows_on_an_empty_link_and_shrinks_on_a_full_one() -> None:
    window = PieceWindow()
    sizes = list[int]()
    for took_s in (0.1, 0.15, 0.35, 0.9, 0.9):
        window.on_piece(Sent(0.0, 0), PIECE_BYTES, took_s)
        sizes.append(window.size)
    assert sizes[0] < sizes[1] == sizes[2] > sizes[4]


def test_a_piece_is_not_lost_while_those_before_it_are_on_a_slow_link() -> None:
    rate_bps, trip_s, pieces = 8000.0, 0.1, 4
    window = PieceWindow(rate_bps)
    window.on_round_trip(trip_s)
    last = Sent(0.0, 0, flying=pieces * PIECE_BYTES)
    arrives_s = trip_s + 8 * pieces * WHOLE_PIECE_BYTES / rate_bps
    # By then the others have been acknowledged.
    assert not window.is_lost(last, arrives_s, PIECE_BYTES)
    assert window.is_lost(last, 2 * arrives_s, PIECE_BYTES)


def test_packets_that_come_less_often_than_expected_are_soon_not_asked_for() -> None:
    frames, now_s = FrameNumbers(0), 0.0
    frames.begin(now_s)
    asked = list[int]()
    for number, interval_s in enumerate([0.1] * 10 + [0.4] * 50):
        asked.append(0)
        for _ in range(round(interval_s / 0.02)):
            now_s += 0.02
            asked[-1] += len(frames.to_ask(now_s, is_reliable=False))
        assert frames.take(number % 64, now_s) == number
    assert sum(asked[10:20]) > 0 and sum(asked[20:]) == 0 and frames.loss == 0


def test_after_a_long_silence_a_decoder_asks_which_packet_has_come() -> None:
    end, silence_s = receiver(), 60.0
    for number, at_s in ((0, 0.1), (7, silence_s)):
        assert end.receive(serialise(FramePacket(number, bytes(9))), at_s) == []
    messages = [parse_message(data) for data in end.payloads(silence_s + 0.5)]
    assert any(isinstance(each, Hello) and each.asks for each in messages)
    # Until it is told it asks for no packet by its number.
    assert not any(isinstance(each, Report) and each.missing for each in messages)


def test_an_encoder_goes_on_for_the_decoders_that_stay() -> None:
    end = sender()
    end.receive(hello(Role.DECODER, b"another1", echo=ENCODER), 1.0)
    assert end.peers == {DECODER, b"another1"}
    end.receive(serialise_message(Bye(Role.DECODER, peer_id(DECODER))), 2.0)
    assert end.peers == {b"another1"} and end.heard_s == 1.0


@pytest.mark.parametrize(("begun", "asked"), [(False, range(20, 40)), (True, range(0))])
def test_a_long_gap_is_asked_for_only_where_nothing_has_come(begun: bool, asked: range) -> None:
    numbers = FrameNumbers(0)
    if begun:
        numbers.take(0, 0.0)
    numbers.synchronise(40, 1.0)
    assert numbers.to_ask(2.0, is_reliable=True) == tuple(asked)


@pytest.mark.parametrize("keeps_all", [False, True])
def test_a_model_has_the_number_of_the_first_frame_packet_that_it_codes(keeps_all: bool) -> None:
    store = ItemStore(keeps_all)
    update = serialise(replace(MODEL, sequence=70 % 64, version=1, version_count=2))
    assert store.add(serialise(replace(MODEL, sequence=0)), frames=0).first == 0
    assert store.add(update, frames=66).first == 70
    assert store.add(LAYER, frames=67).first == 67


def test_a_packet_that_was_asked_for_is_no_later_one() -> None:
    numbers = FrameNumbers(0)
    numbers.synchronise(20, 1.0)
    for number in range(20, 29):
        assert numbers.take(number, 1.0) == number
    assert numbers.take(0, 1.0) == 0 and numbers.take(64 - 36, 1.0) is None


def test_copies_of_early_packets_that_later_ones_have_overtaken_are_not_sent() -> None:
    copies = FrameCopies()
    for number in (0, 1):
        copies.add(1.0, number, bytes([number]))
    copies.add(2.0, 9, b"later")
    assert list(copies.due(0.5, 2)) == []
    assert list(copies.due(1.0, 1 + MAX_BEHIND)) == [b"\1"]
    assert list(copies.due(2.0, 1 + MAX_BEHIND)) == [b"later"]
