"""The directions of a two-way call: any two ends that hear each other take different ones."""

from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.link.direction import (
    ID_BYTES,
    MAX_NAME_BYTES,
    MIN_MESSAGE_BYTES,
    Direction,
    DirectionMessage,
    DirectionNegotiation,
    cut_name,
    direction_key,
    parse_direction,
)

LOW, HIGH = bytes(ID_BYTES), bytes([250]) * ID_BYTES


def test_messages_are_read_back_and_others_are_not() -> None:
    message = DirectionMessage(LOW, Direction.B, "Zoé", True)
    data = message.serialise("zoe", b"key")
    assert parse_direction(data, "zoe", b"key") == message
    assert "Zoé".encode() not in data
    assert parse_direction(data, "zoe", b"other") is None
    assert parse_direction(data, "anna", b"key") is None
    assert parse_direction(data[:-1], "zoe", b"key") is None
    assert parse_direction(data[:20], "zoe", b"key") is None
    assert parse_direction(data + bytes(MAX_NAME_BYTES), "zoe", b"key") is None
    assert parse_direction(b"X" + data[1:], "zoe", b"key") is None
    assert parse_direction(data[:9] + b"\x07" + data[10:], "zoe", b"key") is None
    assert direction_key("zoe") == "n/zoe"


@given(st.text())
def test_any_name_is_cut_to_one_line_that_a_message_holds(person: str) -> None:
    cut = cut_name(person)
    assert len(cut.encode()) <= MAX_NAME_BYTES and "\n" not in cut
    message = DirectionMessage(LOW, Direction.A, person)
    found = parse_direction(message.serialise("zoe", b""), "zoe", b"")
    assert found is not None and found.person == cut_name(cut)


@given(st.binary(max_size=MIN_MESSAGE_BYTES + MAX_NAME_BYTES + 5))
def test_any_bytes_are_a_message_or_none(data: bytes) -> None:
    assert parse_direction(data, "zoe", b"key") is None


def test_who_is_there_is_told_to_the_other_end() -> None:
    one, two = DirectionNegotiation(LOW, person="Anna"), DirectionNegotiation(HIGH, person="Zoe")
    talk([one, two])
    two.receive(one.message)
    one.receive(two.message)
    assert one.other is not None and two.other is not None
    assert (one.other.person, two.other.person) == ("Zoe", "Anna")
    two.is_muted = True
    assert not one.receive(two.message) and one.other.is_muted


def talk(ends: list[DirectionNegotiation]) -> None:
    """Let each say what it has to say until nobody has."""
    said = [end.message for end in ends]
    for _ in range(10):
        answers = []
        for message in said:
            answers += [end.message for end in ends if end.receive(message)]
        said = answers
    assert not said, "they never stop"


@pytest.mark.parametrize("identifiers", list(permutations([LOW, HIGH])))
def test_two_who_ask_at_once_take_different_directions(identifiers: tuple[bytes, bytes]) -> None:
    ends = [DirectionNegotiation(each) for each in identifiers]
    talk(ends)
    assert {end.direction for end in ends} == {Direction.A, Direction.B}
    assert not any(end.has_changed for end in ends)


@pytest.mark.parametrize("first", [LOW, HIGH])
def test_who_comes_later_takes_the_other_direction(first: bytes) -> None:
    one = DirectionNegotiation(first)
    one.hear_nobody()
    assert one.direction is Direction.A
    two = DirectionNegotiation(HIGH if first == LOW else LOW)
    talk([one, two])
    assert (one.direction, two.direction) == (Direction.A, Direction.B)


@pytest.mark.parametrize("left", [Direction.A, Direction.B])
def test_who_comes_back_takes_the_one_that_is_free(left: Direction) -> None:
    stays, comes = DirectionNegotiation(LOW), DirectionNegotiation(HIGH)
    stays.direction = left.other
    talk([stays, comes])
    assert comes.direction is left and stays.direction is left.other


def test_a_listener_keeps_its_direction() -> None:
    listener = DirectionNegotiation(LOW, is_listener=True)
    early = DirectionNegotiation(HIGH)
    early.hear_nobody()
    talk([listener, early])
    assert (listener.direction, early.direction) == (Direction.A, Direction.B)


def test_two_who_had_heard_nobody_settle_it_again() -> None:
    ends = [DirectionNegotiation(each) for each in (LOW, HIGH)]
    for end in ends:
        end.hear_nobody()
    talk(ends)
    assert [end.direction for end in ends] == [Direction.B, Direction.A]
    assert [end.has_changed for end in ends] == [True, False]


def test_a_third_one_is_answered_and_changes_nothing() -> None:
    ends = [DirectionNegotiation(LOW), DirectionNegotiation(HIGH)]
    talk(ends)
    before = [end.direction for end in ends]
    third = DirectionNegotiation(b"\x77" * ID_BYTES)
    talk([*ends, third])
    assert [end.direction for end in ends] == before and third.direction is not None


def test_what_oneself_says_is_not_heard() -> None:
    end = DirectionNegotiation(LOW)
    assert not end.receive(end.message) and end.direction is None
