"""Who listens to a call: news of it is said once, and only where it is some."""

import threading

from protocol.link.peers import Audience


def test_nothing_is_said_while_somebody_listens() -> None:
    said: list[str] = []
    audience = Audience(said.append)
    for who in ("one", "two"):
        audience.came(who)
        assert audience.look()
    audience.went("one")
    assert audience.look() and len(audience) == 1
    assert said == []


def test_the_last_that_goes_and_the_first_that_is_back_are_said_once() -> None:
    said: list[str] = []
    audience = Audience(said.append)
    audience.came("one")
    audience.went("one")
    assert said == []  # until the sender looks
    assert not audience.look() and not audience.look()
    assert said == ["nobody listens any more; sending on"]
    audience.came("two")
    assert audience.look() and audience.look()
    assert said[1:] == ["somebody listens again"]
    audience.went("two")
    assert not audience.look()
    assert said[2:] == ["nobody listens any more; sending on"]


def test_nobody_is_missed_who_never_came() -> None:
    said: list[str] = []
    audience = Audience(said.append)
    assert not audience.look()
    audience.went("somebody else")
    assert not audience.look()
    audience.came("one")
    assert audience.look()
    assert said == []


def test_who_is_told_of_twice_is_there_once() -> None:
    audience = Audience(lambda line: None)
    audience.came("one")
    audience.came("one")
    assert len(audience) == 1
    audience.went("one")
    assert not audience.look()


def test_waiting_ends_with_who_comes_or_with_the_time() -> None:
    audience = Audience(lambda line: None)
    assert not audience.wait(0)
    thread = threading.Thread(target=audience.came, args=("one",))
    thread.start()
    assert audience.wait(20)
    thread.join()
    assert audience.wait(0)
