"""The thread of an end of a link, over connections that are not Zenoh's."""

import secrets

import pytest
from links import MODEL_BYTES, WAIT_S, listening

from protocol.endpoint import Endpoint
from protocol.link.link_service import Carrier, LinkService
from protocol.link.link_sink import LinkSink
from protocol.link.link_source import LinkSource
from protocol.link.plain_protection import PlainProtection

OPTIONS = listening("tcp/127.0.0.1:1")


class BrokenCarrier(Carrier):
    """Its first look at the transport fails."""

    def __init__(self, service: LinkService) -> None:
        pass

    def open(self, connection: int, endpoint: Endpoint) -> None: ...
    def put(self, connection: int, payload: bytes, is_frame: bool, is_hello: bool) -> None: ...
    def ask(self, connection: int) -> None: ...
    def close(self, connection: int) -> None: ...
    def close_all(self) -> None: ...

    def is_linked(self, connection: int) -> bool:
        raise RuntimeError("the transport is broken")


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
