"""Presence of decoders: each change is announced once."""

import threading

from protocol.link.peers import PeerMonitor


def test_nothing_is_said_while_somebody_listens() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    for who in ("one", "two"):
        audience.on_join(who)
        assert audience.poll()
    audience.on_leave("one")
    assert audience.poll() and len(audience) == 1
    assert said == []


def test_the_last_that_goes_and_the_first_that_is_back_are_said_once() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    audience.on_join("one")
    audience.on_leave("one")
    assert said == []  # until the sender looks
    assert not audience.poll() and not audience.poll()
    assert said == ["nobody listens any more; sending on"]
    audience.on_join("two")
    assert audience.poll() and audience.poll()
    assert said[1:] == ["somebody listens again"]
    audience.on_leave("two")
    assert not audience.poll()
    assert said[2:] == ["nobody listens any more; sending on"]


def test_no_departure_is_announced_before_the_first_arrival() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    assert not audience.poll()
    audience.on_leave("somebody else")
    assert not audience.poll()
    audience.on_join("one")
    assert audience.poll()
    assert said == []


def test_a_peer_reported_twice_counts_once() -> None:
    audience = PeerMonitor(lambda line: None)
    audience.on_join("one")
    audience.on_join("one")
    assert len(audience) == 1
    audience.on_leave("one")
    assert not audience.poll()


def test_waiting_ends_with_an_arrival_or_with_the_timeout() -> None:
    audience = PeerMonitor(lambda line: None)
    assert not audience.wait(0)
    thread = threading.Thread(target=audience.on_join, args=("one",))
    thread.start()
    assert audience.wait(20)
    thread.join()
    assert audience.wait(0)
