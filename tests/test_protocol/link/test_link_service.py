"""The thread of an end of a link, over connections that are not Zenoh's."""

import secrets
from queue import SimpleQueue

import pytest
from links import MODEL_BYTES, WAIT_S, listening

from protocol.endpoint import Endpoint
from protocol.link import link_service
from protocol.link.connection import LISTENING, Carrier, Received
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.link_protection import PlainProtection
from protocol.link.link_service import MAX_WAITING_BYTES, LinkService
from protocol.link.link_sink import LinkSink
from protocol.link.link_source import LinkSource

OPTIONS = listening("tcp/127.0.0.1:1")


class IdleCarrier(Carrier):
    """Nobody is connected."""

    def __init__(self, service: LinkService) -> None:
        pass

    def open(self, connection: int, endpoint: Endpoint) -> None: ...
    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None: ...
    def ask(self, connection: int) -> None: ...
    def listen_again(self) -> None: ...
    def close(self, connection: int) -> None: ...
    def close_all(self) -> None: ...

    def is_linked(self, connection: int) -> bool:
        return False


class RecordingCarrier(IdleCarrier):
    """Tells which pages get what is no frame packet, and whether it is a HELLO."""

    def __init__(self, service: LinkService) -> None:
        self.pages: list[tuple[str, bool]] = []

    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None:
        self.pages.append((page, is_hello))

    def is_linked(self, connection: int) -> bool:
        return True


class BrokenCarrier(IdleCarrier):
    """Its first look at the transport fails."""

    def is_linked(self, connection: int) -> bool:
        raise RuntimeError("the transport is broken")


class CountingGuard(PlainProtection):
    """Tells how long the payloads are that it is shown, and believes none."""

    def __init__(self) -> None:
        super().__init__(bytes(8), is_encoder=False)
        self.sizes: SimpleQueue[int] = SimpleQueue()

    def unprotect(self, data: bytes) -> bytes | None:
        self.sizes.put(len(data))
        return None


def guard(is_encoder: bool) -> PlainProtection:
    return PlainProtection(secrets.token_bytes(8), is_encoder)


def test_an_error_in_the_thread_of_a_link_reaches_who_receives() -> None:
    with (
        LinkSource(OPTIONS, guard(False), BrokenCarrier, lambda line: None) as source,
        pytest.raises(RuntimeError, match="transport is broken"),
    ):
        source.receive(WAIT_S)


def test_an_error_in_the_thread_of_a_link_reaches_who_sends() -> None:
    with LinkSink(OPTIONS, guard(True), BrokenCarrier, lambda line: None) as sink:
        with pytest.raises(RuntimeError, match="transport is broken"):
            sink.wait_for_peer(WAIT_S)
        with pytest.raises(RuntimeError, match="transport is broken"):
            sink.send(MODEL_BYTES)


def test_a_flood_of_payloads_takes_bounded_memory_and_later_ones_are_heard() -> None:
    counting, size = CountingGuard(), 64 * 1024
    delivery = DeliveryReceiver(bytes(8), lambda session: None)
    service = LinkService(delivery, counting, None)
    for _ in range(2 * MAX_WAITING_BYTES // size):
        service.post(Received(LISTENING, bytes(size), 0.0))
    service.start(IdleCarrier(service))
    try:
        sizes = [counting.sizes.get(timeout=WAIT_S)]
        service.post(Received(LISTENING, b"later", 0.0))
        while sizes[-1] == size:
            sizes.append(counting.sizes.get(timeout=WAIT_S))
    finally:
        service.stop()
    assert sizes.pop() == len(b"later")
    assert 0 < sum(sizes) <= MAX_WAITING_BYTES


def test_a_page_is_answered_alone_and_the_oldest_of_many_is_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(link_service, "MAX_PAGES", 2)
    now_s = [0.0]
    delivery = DeliverySender(b"encoder1", False, lambda session: None)
    service = LinkService(
        delivery, PlainProtection(b"encoder1", True), None, clock=lambda: now_s[0]
    )
    carrier = RecordingCarrier(service)
    service.attach(carrier)

    def answers_to(session: bytes, page: str) -> list[str]:
        now_s[0] += 1.0
        end = DeliveryReceiver(session, lambda peer: None)
        hello = PlainProtection(session, False).protect(end.hello(now_s[0]))
        service.step()
        carrier.pages.clear()
        service.post(Received(LISTENING, hello, now_s[0], page))
        service.step()
        return [meant for meant, is_hello in carrier.pages if is_hello]

    for number in range(4):
        assert f"page{number}" in answers_to(b"decoder%d" % number, f"page{number}")
    # It is none of a relay any more, or claims to be everybody.
    assert set(answers_to(b"decoder3", "")) == {""}
    assert set(answers_to(bytes(8), "page9")) == {""}
    assert "page2" in answers_to(b"decoder2", "page2")
