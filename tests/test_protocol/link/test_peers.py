"""Presence of decoders: each change is announced once."""

from protocol.link.delivery.peers import PeerMonitor


def test_nothing_is_said_while_somebody_listens() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    for present in (1, 2, 1):
        audience.update(present)
        assert audience.poll() and len(audience) == present
    assert said == []


def test_the_last_that_goes_and_the_first_that_is_back_are_said_once() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    audience.update(1)
    audience.update(0)
    assert said == []  # until the sender looks
    assert not audience.poll() and not audience.poll()
    assert said == ["nobody listens any more; sending on"]
    audience.update(1)
    assert audience.poll() and audience.poll()
    assert said[1:] == ["somebody listens again"]
    audience.update(0)
    assert not audience.poll()
    assert said[2:] == ["nobody listens any more; sending on"]


def test_no_departure_is_announced_before_the_first_arrival() -> None:
    said: list[str] = []
    audience = PeerMonitor(said.append)
    audience.update(0)
    assert not audience.poll()
    audience.update(1)
    assert audience.poll()
    assert said == []
