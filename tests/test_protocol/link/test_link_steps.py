"""Both ends of a link step by step, over connections in memory and at times that a test sets."""

from collections.abc import Iterator

import pytest
from links import END, MODEL_BYTES, frame

from protocol.endpoint import Endpoint
from protocol.link import link_service
from protocol.link.connection import (
    LISTENING,
    Answered,
    Carrier,
    Connector,
    Elsewhere,
    Failed,
    Opened,
    Received,
)
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.endpoints import Failure
from protocol.link.interface import Arrival
from protocol.link.link_protection import PlainProtection
from protocol.link.link_service import LinkService
from protocol.link.messages import Role

STEP_S = 0.05
PLACE = Endpoint("udp", "host", 7447)


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """No step waits: the time is the test's."""
    monkeypatch.setattr(link_service, "TICK_S", 0.0)
    monkeypatch.setattr(link_service, "STOP_S", 0.0)


class Network:
    """Two ends: the encoder connects, the decoder listens; or the other way round.

    now_s: the time of both.  failure: of what is opened from now on.  is_cut: nothing passes.
    is_broken: the transport of what is open has ended.  asked, opened, closed: by who connects.
    """

    def __init__(
        self, endpoint: Endpoint = PLACE, answers: bool = True, decoder_connects: bool = False
    ) -> None:
        self.now_s, self.failure = 100.0, None
        self.is_cut = self.is_broken = False
        self.asked, self.opened, self.closed = list[int](), list[Endpoint](), list[int]()
        self.came = list[Arrival]()
        encoder, decoder = PlainProtection(b"encoder1", True), PlainProtection(b"decoder1", False)
        self.sender = DeliverySender(encoder.session, False, encoder.on_peer)
        receiver = DeliveryReceiver(decoder.session, decoder.on_peer)
        connectors = None, Connector([(endpoint,)])
        to_sender, to_receiver = connectors if decoder_connects else reversed(connectors)
        ends = (
            LinkService(self.sender, encoder, to_sender, clock=lambda: self.now_s),
            LinkService(receiver, decoder, to_receiver, self.came.append, lambda: self.now_s),
        )
        self.connecting, self.listening = reversed(ends) if decoder_connects else ends
        self.connecting.attach(End(self, self.listening, answers))
        self.listening.attach(End(self, self.connecting, answers))
        self.newest = LISTENING  # the connection that the listening end answers on

    failure: Failure | None

    def run(self, seconds: float) -> None:
        """Both ends do what is due, for so long."""
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            # An end handles one event a step.
            for _ in range(8):
                self.connecting.step()
                self.listening.step()


class End(Carrier):
    """The connections of one end of a network."""

    def __init__(self, network: Network, other: LinkService, answers: bool) -> None:
        self._network, self._other, self._answers = network, other, answers

    def open(self, connection: int, endpoint: Endpoint) -> None:
        network = self._network
        network.opened.append(endpoint)
        failure = network.failure
        network.connecting.post(Failed(connection, failure) if failure else Opened(connection))

    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None:
        network = self._network
        if not network.is_cut:
            if connection != LISTENING:
                network.newest, to = connection, LISTENING
            else:
                to = network.newest
            self._other.post(Received(to, payload, network.now_s))

    def ask(self, connection: int) -> None:
        network = self._network
        network.asked.append(connection)
        if self._answers and not network.is_cut:
            network.connecting.post(Answered(connection, Role.RELAY, ""))

    def is_linked(self, connection: int) -> bool:
        return not self._network.is_broken

    def listen_again(self) -> None: ...

    def close(self, connection: int) -> None:
        self._network.closed.append(connection)

    def close_all(self) -> None: ...


@pytest.fixture
def network() -> Iterator[Network]:
    """A call that has begun."""
    network = Network()
    network.run(0.5)
    network.sender.send(MODEL_BYTES)
    yield network


def test_a_call_comes_whole(network: Network) -> None:
    assert network.connecting.is_linked and network.listening.is_linked
    network.run(0.5)
    for number in range(5):
        network.sender.send(frame(number))
        network.run(0.3)
    network.sender.send(END)
    network.run(0.3)
    assert [each.data for each in network.came] == [MODEL_BYTES, *map(frame, range(5)), END]


def test_a_link_that_is_cut_is_asked_over_and_searched_anew(network: Network) -> None:
    network.run(1)
    network.is_cut = True
    network.run(4)
    assert network.asked and set(network.asked) == {0} and len(network.opened) == 1
    network.run(2)
    assert len(network.opened) > 1 and network.connecting.connector is not None
    network.is_cut = False
    network.run(2)
    assert network.connecting.connector.link not in (0, None)
    network.sender.send(frame(0))
    network.run(1)
    assert network.came[-1].data == frame(0)


def test_a_transport_that_has_ended_is_replaced_at_once(network: Network) -> None:
    network.run(0.2)
    network.is_broken = network.is_cut = True
    network.run(0.3)
    assert not network.connecting.is_linked and network.sender.peers == frozenset()
    assert 0 in network.closed and len(network.opened) == 2


def test_where_nothing_is_there_it_is_tried_again_and_said_why() -> None:
    network = Network()
    network.failure = Failure.REFUSED
    network.run(2)
    connector = network.connecting.connector
    assert connector is not None and connector.failure is Failure.REFUSED
    assert len(network.opened) > 2 and not network.connecting.is_linked
    network.connecting.put_now(b"nobody hears it")


def test_a_relay_that_answers_is_a_link_though_nobody_else_is_there() -> None:
    network = Network()
    network.listening.stop()
    network.is_cut, end = True, network.connecting
    network.run(0.1)
    end.post(Answered(0, Role.RELAY, ""))
    end.post(Received(0, b"garbage", network.now_s))
    end.post(Received(0, PlainProtection(b"encoder1", True).protect(b"\xc0\x63"), 0.0))
    network.run(0.2)
    assert end.presence == Answered(0, Role.RELAY, "") and end.is_linked


@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_a_decoder_that_connects_searches_anew_soon_while_frames_should_come(scheme: str) -> None:
    network = Network(Endpoint(scheme, "host", 7447), decoder_connects=True)
    network.run(1)
    network.sender.send(MODEL_BYTES)
    for number in range(3):
        network.sender.send(frame(number))
        network.run(0.3)
    assert [each.data for each in network.came] == [MODEL_BYTES, *map(frame, range(3))]
    network.is_cut = True
    network.run(2)
    assert len(network.opened) > 1


def test_an_end_that_listens_elsewhere_is_tried_there(network: Network) -> None:
    network.run(0.2)
    network.connecting.post(Elsewhere("new", 7449))
    network.run(0.5)
    assert network.opened[-1] == Endpoint("udp", "new", 7449)


@pytest.mark.parametrize(("endpoint", "limit_s"), [(PLACE, 5.0), (Endpoint("quic", "h", 1), 3.0)])
def test_over_quic_silence_is_noticed_sooner(endpoint: Endpoint, limit_s: float) -> None:
    network = Network(endpoint, answers=False)
    network.run(1)
    network.is_cut, tried = True, len(network.opened)
    heard_s = network.now_s
    while len(network.opened) == tried:
        network.run(STEP_S)
    # The last report is up to 3 s old.
    assert limit_s - 3.1 < network.now_s - heard_s < limit_s + 0.1


def test_an_end_runs_until_it_is_stopped_and_tells_what_fails() -> None:
    network = Network()
    network.listening.post(Opened(0))

    class Stopping(End):
        def listen_again(self) -> None:
            network.listening.stop()

    class Broken(End):
        def is_linked(self, connection: int) -> bool:
            raise RuntimeError("the transport is broken")

    network.listening.attach(Stopping(network, network.connecting, False))
    network.listening.run()
    network.listening.raise_failure()
    network.run(0.5)
    network.connecting.attach(Broken(network, network.listening, False))
    network.now_s += 1
    network.connecting.post(Opened(0))
    network.connecting.post(Answered(0, Role.DECODER, "anna"))
    network.connecting.run()
    with pytest.raises(RuntimeError, match="broken"):
        network.connecting.raise_failure()


def test_an_end_without_connections_is_stopped_at_once() -> None:
    guard = PlainProtection(b"decoder1", False)
    LinkService(DeliveryReceiver(guard.session, guard.on_peer), guard, None).stop()
