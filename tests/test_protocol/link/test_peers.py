"""Presence of the other end: each change is announced once."""

from protocol.link.delivery.peers import LOST_S, SILENT_S, EncoderMonitor, PeerMonitor


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


def test_an_encoder_that_is_silent_is_waited_for_and_one_that_leaves_is_not() -> None:
    said: list[str] = []
    encoder = EncoderMonitor(said.append, grace_s=1.0)
    assert not encoder.is_over(SILENT_S, has_left=False) and said == []
    for _ in range(2):
        assert not encoder.is_over(SILENT_S + 0.1, has_left=False)
    assert said == ["nothing comes from the encoder; waiting for it"]
    assert not encoder.is_over(0.0, has_left=False)
    assert said[1:] == ["the encoder is there again"]
    assert not encoder.is_over(1.0, has_left=True) and encoder.is_over(1.1, has_left=True)
    assert not encoder.is_over(LOST_S, has_left=False) and encoder.is_over(LOST_S + 1, False)
