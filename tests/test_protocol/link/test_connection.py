"""Which connections are tried, kept and given up."""

from protocol.endpoint import Endpoint
from protocol.link.connection import Close, Connector, Open
from protocol.link.endpoints import Failure

UDP, TCP = Endpoint("udp", "host", 7447), Endpoint("tcp", "host", 7447)
PATIENCE_S = 2.0


def run(
    connector: Connector, begin_s: float, end_s: float, step_s: float = 0.05
) -> list[tuple[float, Open | Close]]:
    """What it asks for from one time to another."""
    times = [begin_s + step_s * i for i in range(round((end_s - begin_s) / step_s))]
    return [(t, action) for t in times for action in connector.tick(t, PATIENCE_S)]


def opened(actions: list[tuple[float, Open | Close]]) -> list[tuple[float, str | None]]:
    return [(t, each.endpoint.scheme) for t, each in actions if isinstance(each, Open)]


def closed(actions: list[tuple[float, Open | Close]]) -> list[int]:
    return [each.connection for _, each in actions if isinstance(each, Close)]


def test_candidates_follow_one_another_quickly_at_first() -> None:
    connector = Connector([(UDP,)])
    times = [t for t, _ in opened(run(connector, 0, 20))]
    assert sum(t < 4 for t in times) in range(8, 12) and sum(t > 12 for t in times) in range(6, 10)


def test_the_other_transport_takes_turns_after_some_seconds() -> None:
    connector = Connector([(UDP, TCP)])
    begun = opened(run(connector, 0, 3.5))
    assert {scheme for _, scheme in begun} == {"udp"}
    assert {scheme for _, scheme in opened(run(connector, 3.5, 9))} == {"udp", "tcp"}


def test_a_transport_that_repeats_its_setup_has_one_candidate() -> None:
    connector = Connector([(TCP,)])
    assert len(opened(run(connector, 0, 5))) == 1
    connector.on_failed(0, Failure.REFUSED)
    assert connector.failure is Failure.REFUSED
    assert len(opened(run(connector, 5, 6))) == 1


def test_the_first_that_hears_becomes_the_link_and_the_others_are_closed() -> None:
    connector = Connector([(UDP,)])
    run(connector, 0, 1)
    for number in range(3):
        connector.on_opened(number, 1)
    connector.on_heard(1, 1)
    assert connector.link == 1 and connector.endpoint == UDP
    assert sorted(closed(run(connector, 1, 1.2))) == [0, 2]
    connector.on_heard(1, 2.5)
    assert opened(run(connector, 1.2, 4)) == []


def test_the_other_end_is_tried_where_it_is_said_to_listen_beside_the_link() -> None:
    connector = Connector([(UDP, TCP)])
    run(connector, 0, 0.1)
    connector.on_opened(0, 0.1)
    connector.on_heard(0, 0.1)
    connector.on_elsewhere("new", 7449)
    connector.on_elsewhere("new", 7449)
    ((_, told),) = run(connector, 1, 1.05)
    assert told == Open(1, Endpoint("udp", "new", 7449))
    connector.on_elsewhere("new", 7449)
    assert run(connector, 1.05, 1.1) == [], "it is being tried"
    connector.on_opened(1, 1.1)
    connector.on_presence(1, 1.1)
    assert connector.link == 0, "anybody may answer there"
    connector.on_heard(1, 1.2)
    connector.on_presence(1, 1.2)
    assert connector.link == 1 and closed(run(connector, 1.2, 1.3)) == [0]
    connector.on_elsewhere("new", 7449)
    assert opened(run(connector, 1.3, 2)) == [], "it is there"


def test_a_link_that_is_heard_again_is_not_left_and_few_places_are_remembered() -> None:
    connector = Connector([(UDP,)])
    run(connector, 0, 0.1)
    connector.on_heard(0, 0.1)
    for number in range(20):
        connector.on_elsewhere(f"host{number}", 7447)
    connector.on_heard(0, 0.2)
    assert run(connector, 0.2, 1) == []
    hosts = {each.endpoint.host for _, each in run(connector, 3, 20) if isinstance(each, Open)}
    assert hosts == {"host", *(f"host{number}" for number in range(16, 20))}


def test_nobody_is_followed_whose_certificate_names_the_host() -> None:
    connector = Connector([(Endpoint("tls", "host", 7447),)])
    connector.on_elsewhere("new", 7449)
    assert {each.endpoint.host for _, each in run(connector, 0, 3) if isinstance(each, Open)} == {
        "host"
    }


def test_a_silent_link_is_held_until_another_one_hears() -> None:
    connector = Connector([(UDP,)])
    run(connector, 0, 0.1)
    connector.on_opened(0, 0.1)
    connector.on_heard(0, 0.1)
    actions = run(connector, 0.2, 3)
    assert opened(actions)[0][0] > 2 and closed(actions) == [] and connector.link == 0
    connector.on_opened(1, 3)
    connector.on_heard(1, 3)
    assert connector.link == 1 and 0 in closed(run(connector, 3, 3.1))


def test_a_broken_link_is_replaced_at_once() -> None:
    connector = Connector([(UDP,)])
    run(connector, 0, 0.1)
    connector.on_opened(0, 0.1)
    connector.on_heard(0, 0.1)
    run(connector, 0.2, 0.6)
    connector.on_broken(0)
    assert connector.link is None
    actions = run(connector, 0.6, 0.8)
    assert closed(actions) == [0] and len(opened(actions)) == 1


def test_a_candidate_that_hears_nothing_is_closed() -> None:
    connector = Connector([(UDP,)])
    run(connector, 0, 0.1)
    connector.on_opened(0, 0.1)
    assert 0 not in closed(run(connector, 0.1, 2))
    assert 0 in closed(run(connector, 2, 2.3))


def test_what_a_closed_candidate_does_has_no_effect() -> None:
    connector = Connector([(UDP,)])
    connector.on_opened(5, 1)
    connector.on_heard(5, 1)
    connector.on_failed(5, Failure.SILENT)
    connector.on_broken(5)
    assert connector.link is None and connector.failure is None and connector.opened == ()
