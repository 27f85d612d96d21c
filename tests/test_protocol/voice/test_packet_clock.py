"""The clock that tells when the speech of a packet is spoken."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from packets import MODEL

from protocol.call_parameters import CallParameters
from protocol.limits import FIRST_WINDOW, LATE_WINDOW
from protocol.model_packet import ModelPacket
from protocol.voice.packet_clock import PacketClock

# 25 frames a second: a speech frame for each source frame.
CALL = CallParameters("default", 640, 480, 25, 1, 612.5, frames_per_packet=4, voice="1200")
FIRST = replace(MODEL, call=CALL, sequence=0, version_count=3)


def clock_of(model: ModelPacket = FIRST, number: int | None = None) -> PacketClock:
    clock = PacketClock()
    clock.add_model(model, number)
    return clock


def test_a_clock_without_a_model_has_no_voice() -> None:
    clock = PacketClock()
    assert (clock.voice, clock.call, clock.newest) == ("off", None, -1)
    clock.resume(5)
    assert clock.newest == -1


def test_a_model_tells_the_call() -> None:
    clock = clock_of()
    assert (clock.voice, clock.call, clock.newest) == ("1200", CALL, -1)
    assert clock_of(replace(FIRST, sequence=5)).newest == 4
    assert clock_of(FIRST, 70).newest == 69


def test_speech_follows_the_pictures_of_the_default_profile() -> None:
    clock = clock_of()
    assert [clock.expected(number) for number in range(3)] == [0, 1, 5]
    assert [clock.end(number) for number in range(3)] == [1, 5, 9]


def test_speech_follows_the_pictures_of_the_thesis_profile() -> None:
    call = CallParameters("thesis", 640, 480, 30, 1, 612.5, start_frame=3, voice="700C")
    clock = clock_of(replace(FIRST, call=call))
    # Samples at frames 3, 6, 9; a speech frame begins every 1.2 frames.
    assert [clock.expected(number) for number in range(3)] == [3, 4, 6]
    assert [clock.end(number) for number in range(3)] == [4, 6, 9]


@given(st.integers(0, 200), st.lists(st.integers(1, 40), max_size=20))
def test_numbers_come_back_from_six_bits(first: int, steps: list[int]) -> None:
    clock = clock_of(replace(FIRST, sequence=first % 64), first)
    number = first
    for step in steps:
        assert clock.add_packet(number % 64) == number == clock.newest
        number += step


@given(st.integers(LATE_WINDOW, 200), st.integers(0, LATE_WINDOW))
def test_a_late_packet_keeps_its_number(newest: int, late: int) -> None:
    clock = clock_of()
    clock.add_packet(newest % 64, newest)
    assert clock.add_packet((newest - late) % 64) == newest - late
    assert clock.newest == newest


def test_an_update_is_in_use_from_its_packet_on() -> None:
    clock = clock_of()
    clock.add_packet(0)
    update = replace(FIRST, call=replace(CALL, start_frame=20), version=1, sequence=3)
    clock.add_model(update)
    clock.add_model(update)
    clock.add_model(FIRST)
    assert [clock.expected(number) for number in (1, 2, 3, 4)] == [1, 5, 20, 21]
    clock.add_packet(3)
    assert [clock.expected(number) for number in (1, 2, 3, 4)] == [1, 5, 20, 21]
    clock.add_model(replace(update, version=2), 67)
    clock.add_packet(2)
    assert clock.add_packet(4) == 4
    assert [clock.expected(number) for number in (66, 67, 68)] == [269, 20, 21]


def test_numbers_of_packets_that_a_lost_face_leaves_out_count() -> None:
    clock = clock_of()
    clock.add_packet(0)
    clock.resume(21)
    assert clock.newest == 5 and clock.expected(6) == 21
    clock.resume(2)
    assert clock.newest == 5


def test_who_joins_late_does_not_count_packets_from_the_start() -> None:
    for clock in (clock_of(replace(FIRST, version=1)), clock_of()):
        number = clock.add_packet(FIRST_WINDOW + 1)
        clock.resume(400)
        assert clock.newest == number


def test_who_joins_at_a_frame_knows_the_numbers_of_packets() -> None:
    clock = clock_of(replace(FIRST, version=1))
    clock.join(1 + 4 * 69)
    assert clock.add_packet(70 % 64) == 70 and not clock.begins_call(70)
    assert (clock.first_frame(70), clock.end_frame(70)) == (277, 281)
    clock.join(0)
    assert clock.newest == 70
    clock.resume(400)
    assert clock.newest == 99


def test_without_a_model_nobody_joins() -> None:
    clock = PacketClock()
    clock.join(5)
    assert clock.newest == -1


def test_the_first_packet_of_a_call_is_that_of_its_first_model() -> None:
    clock = clock_of()
    clock.add_packet(0)
    assert clock.begins_call(0) and not clock.begins_call(1)
    assert (clock.first_frame(0), clock.end_frame(0)) == (0, 1)
    clock.add_model(replace(FIRST, version=1, sequence=2))
    clock.add_packet(2)
    assert not clock.begins_call(2)


def test_packets_are_due_when_their_newest_picture_is() -> None:
    clock = clock_of()
    assert clock.packets_until(8) == range(3)
    clock.add_packet(0)
    assert clock.packets_until(3) == range(1, 1)
    assert clock.packets_until(12) == range(1, 4)
