"""The state and the cost of a call, in words."""

from dataclasses import replace

import pytest

from protocol.link.interface import Reachability
from risorius.live_call.call_words import cost_words, delay_ms, state_words, stranger_words
from risorius.live_call.messages import Presence, Receiving, Sending, Traffic

SENDING = Sending(Traffic(100, 3, 1.0), Reachability.NO_PEER, 0.0, None, "looking for you")
LINKED = replace(SENDING, reach=Reachability.HAS_PEER)
BUSY = replace(SENDING, reach=Reachability.BUSY)
BROKEN = replace(SENDING, reach=Reachability.NO_LINK)
RECEIVING = Receiving(Traffic(250, 6, 2.0), Presence.HERE, 0.02, 0.32)


@pytest.mark.parametrize(
    ("is_listening", "has_picture", "sending", "presence", "text"),
    [
        (True, False, None, Presence.AWAITED, "waiting for a call"),
        (False, False, SENDING, Presence.AWAITED, "calling"),
        (True, False, LINKED, Presence.AWAITED, "is calling"),
        (False, False, LINKED, Presence.AWAITED, "answers"),
        (False, False, SENDING, Presence.HERE, "answers"),
        (True, False, LINKED, Presence.SILENT, "is calling"),
        (True, False, SENDING, Presence.SILENT, "link lost, trying"),
        (True, True, LINKED, Presence.HERE, ""),
        (False, False, BUSY, Presence.AWAITED, "is in another call"),
        (True, True, SENDING, Presence.SILENT, "link lost, trying"),
        (False, True, BROKEN, Presence.HERE, "link lost, trying"),
        (False, False, BROKEN, Presence.AWAITED, "link lost, trying"),
        (True, False, SENDING, Presence.LEFT, "has left"),
        (True, False, LINKED, Presence.LEFT, "is calling"),
    ],
)
def test_the_state_is_said_in_words(
    is_listening: bool, has_picture: bool, sending: Sending | None, presence: Presence, text: str
) -> None:
    words = state_words("anna", is_listening, has_picture, sending, presence)
    assert words.text == text
    assert words.is_trouble == ("lost" in text)
    # What is over the picture would hide it.
    assert bool(words.over) == (not has_picture)


def test_a_call_that_nobody_has_named_has_no_name() -> None:
    words = [
        state_words("call", False, False, sending, Presence.AWAITED).over
        for sending in (SENDING, LINKED, BUSY)
    ]
    assert words[0] == "Calling …"
    assert all("call answers" not in each and not each.startswith("call ") for each in words)
    known = state_words("call", False, False, LINKED, Presence.AWAITED, knows_person=True)
    assert known.over == "call answers …"


def test_whoever_is_in_another_call_is_not_shown() -> None:
    words = state_words("anna", False, True, BUSY, Presence.HERE)
    assert words.text == "is in another call" and words.over


def test_strangers_are_told_of_at_both_ends() -> None:
    assert "knocks" in stranger_words(is_listening=True)
    assert "another call" in stranger_words(is_listening=False)


def test_a_camera_that_is_off_is_said_to_be() -> None:
    words = state_words("anna", True, True, LINKED, Presence.HERE, is_camera_off=True)
    assert words.text == "camera off" and not words.over


def test_the_cost_counts_what_a_second_takes_over_udp() -> None:
    words = cost_words(LINKED, RECEIVING)
    assert "up 800 bit/s" in words and "down 1\u202f000 bit/s" in words
    assert "loss 2\u00a0%" in words and words.endswith("looking for you")
    assert int(words.split("(UDP ")[1].split(")")[0].replace("\u202f", "")) > 800 + 3 * 8 * 28


def test_nothing_is_said_of_what_is_not_known() -> None:
    assert cost_words(None, None) == ""
    assert "down" not in cost_words(SENDING, replace(RECEIVING, presence=Presence.LEFT))
    assert delay_ms(SENDING, None) is None


def test_a_packet_that_fills_and_half_a_round_trip_are_delay() -> None:
    assert delay_ms(SENDING, RECEIVING) == 320
    assert delay_ms(replace(SENDING, round_trip_s=0.1), RECEIVING) == pytest.approx(370)


def test_who_reaches_nobody_is_told_so_in_time() -> None:
    state = "zoe", False, False, SENDING, Presence.AWAITED
    assert state_words(*state, waited_s=5.0).text == "calling"
    late = state_words(*state, waited_s=20.0)
    assert late.text == "nobody there yet" and "zoe is not there yet" in late.over
    assert (
        state_words("zoe", False, False, LINKED, Presence.AWAITED, waited_s=20.0).text == "answers"
    )


def test_nothing_goes_up_where_nobody_receives() -> None:
    assert "up" not in cost_words(SENDING, None)


def test_who_has_said_their_name_is_called_by_it() -> None:
    known = state_words("Zoe", True, False, LINKED, Presence.AWAITED, knows_person=True)
    assert known.over == "Zoe is calling …"
    unknown = state_words("anna", True, False, LINKED, Presence.AWAITED)
    assert unknown.over == "Somebody is calling …"
    left = state_words("anna", True, True, SENDING, Presence.LEFT)
    assert left.over == "The other one has left."
