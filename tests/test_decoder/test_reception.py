"""A call over a lossy link: order, patience, repairs, silence, an encoder that starts again."""

import gc
from collections.abc import Iterable, Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from layer_streams import BASE, PACKED, frames
from studio import REST

from benchmarks.simulated_link import SentPacket, SimulatedLink, arrivals
from decoder.playout.arrival_clock import MAX_WAIT_S, MIN_WAIT_S, ArrivalClock
from decoder.playout.encoder_session import SILENCE_S, EncoderSession
from decoder.playout.playout import Playout, PlayoutFrame
from decoder.playout.received_frames import MAX_DAMAGES_TOLD, DecodeStats
from decoder.playout.receiver import Receiver
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival
from protocol.packets import ControlKind, ControlPacket, parse_packet, serialise
from shared_model.errors import UserError

COUNT = 12
FPS = BASE.call.fps
PACKET_S = PACKED / FPS
FIRST = replace(BASE, version=0, version_count=1)
MODEL = serialise(FIRST)
PACKETS = frames(COUNT, model=FIRST)
FRAMES = 1 + (COUNT - 1) * PACKED
END = serialise(ControlPacket(0, ControlKind.END, FRAMES))


def sent(count: int = COUNT) -> list[SentPacket]:
    """The call as an encoder sends it."""
    packets = [SentPacket(data, k * PACKET_S, k) for k, data in enumerate(PACKETS[:count])]
    return [SentPacket(MODEL, 0.0, 0), *packets, SentPacket(END, COUNT * PACKET_S, COUNT)]


def play(receiver: Receiver, arriving: Iterable[Arrival]) -> Iterator[PlayoutFrame]:
    for arrival in arriving:
        while (due_s := receiver.release_s) is not None and due_s < arrival.time_s:
            yield from receiver.poll(due_s)
        yield from receiver.receive(arrival)
    while (due_s := receiver.release_s) is not None:
        yield from receiver.poll(due_s)


def on_time(numbers: Iterable[int], session: int = 0, start_s: float = 0.0) -> list[Arrival]:
    """A model and these frame packets, each when it is due."""
    model = Arrival(MODEL, start_s, session, 0)
    return [
        model,
        *(Arrival(PACKETS[k], start_s + k * PACKET_S, session, k) for k in numbers),
    ]


def clean() -> list[PlayoutFrame]:
    receiver = Playout()
    return [
        frame for data in (MODEL, *PACKETS, END) for frame in receiver.receive(parse_packet(data))
    ]


def differences(played: list[PlayoutFrame]) -> list[float]:
    """How far each frame's face is from that of the whole call, mm."""
    return [
        float(np.abs(one.face.pose.translation_mm - true.face.pose.translation_mm).max())
        for one, true in zip(played, clean(), strict=True)
    ]


@pytest.mark.parametrize(
    "link",
    [
        SimulatedLink(),
        SimulatedLink(jitter_s=0.4, duplicates=0.3),
        SimulatedLink(loss=0.25),
        SimulatedLink(loss=0.25, burst=3, delay_s=0.02),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_what_is_repeated_in_time_is_shown_as_if_nothing_had_been_lost(
    link: SimulatedLink, seed: int
) -> None:
    receiver = Receiver()
    played = list(play(receiver, arrivals(sent(), link, seed)))
    assert [frame.index for frame in played] == list(range(FRAMES)) and receiver.ended
    if not any(frame.lost for frame in played):
        assert max(differences(played)) == 0
    assert link.loss or not receiver.counts.lost


def test_a_missing_packet_is_waited_for_but_not_for_ever() -> None:
    receiver = Receiver()
    shown = list(play(receiver, on_time([0, 1, 3])[:-1]))
    held = receiver.receive(Arrival(PACKETS[3], 3 * PACKET_S, 0, 3))
    assert held == [] and receiver.release_s == pytest.approx(2 * PACKET_S + MAX_WAIT_S)
    assert receiver.poll(2 * PACKET_S + MAX_WAIT_S - 0.01) == []
    rest = receiver.poll(2 * PACKET_S + MAX_WAIT_S)
    assert [frame.index for frame in shown + rest] == list(range(1 + 3 * PACKED))
    assert sum(frame.lost for frame in rest) == PACKED and receiver.counts.lost == 1


def test_a_packet_after_its_time_makes_what_follows_exact() -> None:
    receiver = Receiver(max_wait_s=0.0)
    late = Arrival(PACKETS[2], 5.5 * PACKET_S, 0, 2)
    order = sorted([*on_time(k for k in range(COUNT) if k != 2), late], key=lambda a: a.time_s)
    played = list(play(receiver, order))
    played += receiver.receive(Arrival(END, COUNT * PACKET_S, 0, COUNT))
    assert receiver.counts.late == 1
    # Exact again after the frames in which the picture returns.
    assert max(differences(played)[1 + 6 * PACKED :]) == 0


def test_after_a_loss_that_is_not_repaired_the_picture_is_exact_within_a_second() -> None:
    receiver = Receiver()
    played = list(play(receiver, on_time(k for k in range(COUNT) if k != 3)))
    exact = differences([*played])[1 + 3 * PACKED + round(FPS) :]
    assert max(exact) == 0


def test_patience_grows_with_what_repetitions_take() -> None:
    clock = ArrivalClock()
    for k in range(20):
        clock.note(k, k, is_overtaken=False)
    assert clock.wait_s == MAX_WAIT_S
    clock.note(20, 20.2, is_overtaken=True)
    assert clock.wait_s == MIN_WAIT_S
    for k in range(21, 40):
        clock.note(k, k + 0.4, is_overtaken=True)
    assert MIN_WAIT_S < clock.wait_s <= MAX_WAIT_S


def test_packets_before_their_model_are_kept() -> None:
    receiver = Receiver()
    early = [Arrival(PACKETS[k], k * PACKET_S, 0, k) for k in range(3)]
    assert list(play(receiver, early)) == []
    assert len(receiver.receive(Arrival(MODEL, 1.0, 0, 0))) == 1 + 2 * PACKED


def test_a_late_joiner_knows_its_place_in_the_call() -> None:
    """Beyond 64 packets, and with an update that began before it came."""
    start = 1 + 99 * PACKED
    update = replace(
        BASE,
        version=1,
        version_count=2,
        sequence=100 % 64,
        call=replace(BASE.call, start_frame=start),
    )
    receiver = Receiver()
    coded = frames(3, first=29, model=BASE)
    packets = [bytes([(130 + k) % 64]) + data[1:] for k, data in enumerate(coded[1:])]
    order = [Arrival(serialise(update), 0.0, 0, 100)]
    order += [Arrival(data, k * PACKET_S, 0, 130 + k) for k, data in enumerate(packets)]
    played = list(play(receiver, order))
    assert receiver.first.playout.joined_late
    assert [frame.index for frame in played] == list(
        range(start + 1 + 29 * PACKED, start + 1 + 31 * PACKED)
    )


def test_pictures_from_before_it_joined_are_counted_apart() -> None:
    receiver = Receiver()
    played = list(play(receiver, on_time(range(3, 6))))
    assert [frame.index for frame in played] == list(range(1 + 5 * PACKED))
    assert receiver.first.playout.before_join == 1 + 2 * PACKED
    assert not any(frame.lost for frame in played)


def test_a_long_silence_is_filled_with_the_last_face_which_is_said_to_be_lost() -> None:
    receiver = Receiver()
    shown = list(play(receiver, on_time(range(2))))
    assert receiver.poll(PACKET_S + SILENCE_S) == []
    held = receiver.poll(PACKET_S + SILENCE_S + 2)
    assert len(held) == pytest.approx(2 * FPS, abs=2)
    assert all(frame.lost and frame.frozen and frame.face is shown[-1].face for frame in held)


def test_of_an_encoder_slower_than_its_source_every_frame_is_shown_once() -> None:
    receiver = Receiver()
    played = receiver.receive(Arrival(MODEL, 0.0, 0, 0))
    for k in range(COUNT):
        now_s = 12 * k * PACKET_S
        played += receiver.receive(Arrival(PACKETS[k], now_s, 0, k))
        played += receiver.poll(now_s + 11 * PACKET_S)
    assert [frame.index for frame in played] == list(range(len(clean())))
    assert not any(frame.lost for frame in played)


def test_a_restarted_encoder_goes_on_where_the_call_would_be() -> None:
    receiver = Receiver()
    before = list(play(receiver, on_time(range(4))))
    again_s = 10.0
    after = list(play(receiver, on_time(range(4), session=1, start_s=again_s)))
    indices = [frame.index for frame in [*before, *after]]
    assert indices == list(range(len(indices)))
    fresh = [frame for frame in after if not frame.lost]
    assert len(fresh) == 1 + 3 * PACKED and fresh[0].index == round(again_s * FPS)
    assert receiver.counts.restarts == 1
    # What is still under way from the encoder before is nothing to anyone.
    assert receiver.receive(Arrival(PACKETS[5], 11.0, 0, 5)) == []
    receiver.receive(Arrival(END, 12.0, 1, 4))
    assert receiver.ended


def test_no_step_is_much_greater_than_those_of_the_source() -> None:
    """Neither at a repair, nor after a silence, nor at a new encoder's model."""
    receiver = Receiver(max_wait_s=0.0)
    order = [*on_time([0, 1, 2, 4, 5]), Arrival(PACKETS[3], 5.2 * PACKET_S, 0, 3)]
    order += on_time(range(6), session=1, start_s=4.0)
    played = list(play(receiver, order))
    places = np.array([frame.face.pose.translation_mm for frame in played])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    true = np.array([frame.face.pose.translation_mm for frame in clean()])
    fastest = np.linalg.norm(np.diff(true, axis=0), axis=1).max()
    assert steps.max() <= 2 * fastest + 1e-9


def test_an_encoder_that_comes_back_with_other_pictures_is_one_error() -> None:
    receiver = Receiver()
    list(play(receiver, on_time(range(3))))
    other = replace(FIRST, call=replace(BASE.call, width=BASE.call.width + 16))
    receiver.receive(Arrival(serialise(other), 5.0, 1, 0))
    with pytest.raises(UserError, match="came back with pictures of"):
        receiver.receive(Arrival(PACKETS[0], 5.0, 1, 0))


def test_packets_of_a_call_file_are_never_waited_for() -> None:
    receiver = Receiver()
    order = [Arrival(data, 0.0) for data in (MODEL, *PACKETS[:3], *PACKETS[4:], END)]
    played = [frame for arrival in order for frame in receiver.receive(arrival)]
    assert len(played) == FRAMES and sum(frame.lost for frame in played) == PACKED


def test_an_encoder_that_starts_again_before_its_model_came_begins_the_call() -> None:
    receiver = Receiver()
    assert receiver.receive(Arrival(PACKETS[0], 0.0, 0, 0)) == []
    played = list(play(receiver, on_time(range(2), session=1, start_s=3.0)))
    assert [frame.index for frame in played] == list(range(1 + PACKED))


def test_of_encoders_that_have_started_again_counts_stay_and_little_else() -> None:
    gc.collect()
    before = sessions_alive()
    receiver = Receiver()
    for session in range(9):
        order = on_time([0, 1, 3, 4], session, 2.0 * session)
        list(play(receiver, order))
        receiver.poll(2.0 * session + 1.9)
    gc.collect()
    assert receiver.counts.restarts == 8 and receiver.counts.lost == 9
    assert sessions_alive() - before <= 3


def sessions_alive() -> int:
    return sum(isinstance(each, EncoderSession) for each in gc.get_objects())


def test_of_many_damaged_packets_and_of_pictures_numbers_are_kept() -> None:
    stats, receiver = DecodeStats(), Receiver()
    for number in range(1000):
        stats.note_damage(ProtocolError(f"packet {number}"), receiver)
        stats.note_shown(PlayoutFrame(number, REST, FIRST, Fraction(number, 25)))
    assert stats.damaged == stats.pictures == 1000
    assert stats.damages == [f"packet {number}" for number in range(MAX_DAMAGES_TOLD)]
    assert not stats.shown_ns


def test_a_damaged_packet_is_told_and_the_others_take_effect() -> None:
    told = list[ProtocolError]()
    receiver = Receiver(on_damage=told.append)
    order = on_time(range(COUNT))
    # A packet of another number than its own, in the middle of those that are held behind a gap.
    order[3] = replace(order[3], data=PACKETS[5])
    held, rest = order[2:5], order[1:2] + order[5:]
    played = list(play(receiver, [order[0], *held, *rest]))
    assert len(told) == 1 and "has sequence number" in str(told[0])
    assert [frame.index for frame in played] == list(range(1 + (COUNT - 1) * PACKED))
