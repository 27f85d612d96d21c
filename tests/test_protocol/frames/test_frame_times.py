"""Times packets: one encoding, bounds, and the clock of a receiver."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.frames.frame_times import FrameClock, TimesPacket, parse_times, serialise_times
from protocol.limits import MAX_CONTROL_PACKET_BYTES, MAX_TICK_STEP, MAX_TIMED_FRAMES
from protocol.packets import ControlKind, ControlPacket, parse_packet, serialise

STEPS = st.lists(st.integers(-MAX_TICK_STEP, MAX_TICK_STEP), max_size=MAX_TIMED_FRAMES - 1)


@given(st.integers(-(2**31) + 1, 2**31 - 1), STEPS, st.integers(0, 2**32 - 1))
def test_any_times_come_back_from_a_packet_within_its_limit(
    first: int, steps: list[int], frame: int
) -> None:
    ticks = [first]
    for step in steps:
        ticks.append(ticks[-1] + step)
    packet = TimesPacket(3, frame, tuple(ticks))
    data = serialise(packet)
    assert len(data) <= MAX_CONTROL_PACKET_BYTES
    assert parse_packet(data) == packet


def test_regular_gaps_cost_less_than_two_bits_a_frame() -> None:
    ticks = tuple(48 * (frame // 16) for frame in range(MAX_TIMED_FRAMES))
    assert 8 * len(serialise_times(TimesPacket(0, 0, ticks))) < 2 * MAX_TIMED_FRAMES


def test_superfluous_and_missing_bytes_are_refused() -> None:
    data = serialise(TimesPacket(0, 5, (0, 3, 3, 7)))
    for wrong in (data + b"\0", data + b"\1", data[:2]):
        with pytest.raises(ProtocolError):
            parse_packet(wrong)


@given(st.binary(max_size=40))
def test_any_bytes_are_times_of_one_encoding_or_an_error(data: bytes) -> None:
    try:
        packet = parse_times(0, data)
    except ValueError:
        return
    assert serialise_times(packet) == data


def test_times_beyond_the_limits_are_refused() -> None:
    for ticks in ((), (0,) * (MAX_TIMED_FRAMES + 1), (0, MAX_TICK_STEP + 1), (2**31,)):
        with pytest.raises(ValueError, match="expected an integer"):
            TimesPacket(0, 0, ticks)
    with pytest.raises(ValueError, match="expected a TimesPacket"):
        ControlPacket(0, ControlKind.TIMES, 0)


def test_a_clock_without_times_runs_at_the_frame_rate() -> None:
    clock = FrameClock()
    assert clock.is_constant
    assert clock.time_s(50, Fraction(25)) == 2


def test_a_clock_keeps_the_last_deviation_where_times_are_missing() -> None:
    clock, fps = FrameClock(), Fraction(25)
    clock.receive(TimesPacket(0, 0, (0, 16, 32)))
    clock.receive(TimesPacket(0, 5, (-16, -16)))
    assert not clock.is_constant
    shown = [clock.time_s(frame, fps) * fps for frame in range(8)]
    assert shown == [0, 2, 4, 5, 6, 4, 5, 6]
