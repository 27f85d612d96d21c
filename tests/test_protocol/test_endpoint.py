"""Endpoints as users name them."""

import socket

import pytest
from own_interface import OwnInterface

from protocol.endpoint import (
    DEFAULT_SCHEMES,
    Endpoint,
    OwnAddress,
    address_for_others,
    parse_endpoint,
    parse_remote_endpoint,
)
from protocol.link.interface import LinkOptions
from shared_model.errors import UserError


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("192.0.2.7:7000", Endpoint(None, "192.0.2.7", 7000)),
        ("192.0.2.7", Endpoint(None, "192.0.2.7", 7447)),
        (":7000", Endpoint(None, "0.0.0.0", 7000)),
        ("tcp/:7000", Endpoint("tcp", "0.0.0.0", 7000)),
        ("udp/host.example", Endpoint("udp", "host.example", 7447)),
        ("[2001:db8::7]:7000", Endpoint(None, "2001:db8::7", 7000)),
        ("quic/h:1?mixed_rel=1#x=2", Endpoint("quic", "h", 1, "?mixed_rel=1#x=2")),
    ],
)
def test_endpoints_are_read(text: str, endpoint: Endpoint) -> None:
    assert parse_endpoint(text) == endpoint


def test_zenoh_gets_a_scheme_a_host_and_a_port() -> None:
    assert parse_endpoint("[::1]").locators == tuple(f"{s}/[::1]:7447" for s in DEFAULT_SCHEMES)
    assert parse_endpoint("udp/h:1?rel=1").locators == ("udp/h:1?rel=1",)


def test_a_link_listens_on_all_its_endpoints_and_connects_to_any_of_each_place() -> None:
    link = LinkOptions("call", listen=("tcp/:0",), connect=("udp/h:1", "h:2"))
    assert link.listen_locators == ("tcp/0.0.0.0:0",)
    connect = [[each.locators[0] for each in place] for place in link.connect_endpoints]
    assert connect == [["udp/h:1"], ["udp/h:2", "tcp/h:2"]]


@pytest.mark.parametrize(
    ("text", "is_reliable"),
    [("udp/h:1", False), ("tcp/h:1", True), ("udp/h:1?rel=1", True), ("quic/h:1", True)],
)
def test_what_repeats_what_was_lost(text: str, is_reliable: bool) -> None:
    assert parse_endpoint(text).is_reliable is is_reliable


@pytest.mark.parametrize("text", ["", "http://h:1", "sctp/h:1", "h:x", "a b:1", "h:123456", "::1"])
def test_what_is_no_endpoint_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="endpoint"):
        parse_endpoint(text)


@pytest.mark.parametrize(
    ("text", "reason"), [("h:0", "port 0"), (":7447", "name the host"), ("[::]:7447", "name the")]
)
def test_nobody_can_be_connected_to_at(text: str, reason: str) -> None:
    parse_endpoint(text)
    with pytest.raises(UserError, match=reason):
        parse_remote_endpoint(text)
    with pytest.raises(UserError, match=reason):
        LinkOptions("call", connect=(text,))


@pytest.mark.parametrize(
    ("host", "is_loopback"),
    [
        ("127.0.0.1", True),
        ("127.3.2.1", True),
        ("localhost", True),
        ("[::1]", True),
        ("0.0.0.0", False),
        ("[::]", False),
        ("192.0.2.7", False),
        ("127.0.0.1.example", False),
    ],
)
def test_only_this_host_reaches_loopback(host: str, is_loopback: bool) -> None:
    assert parse_endpoint(f"{host}:1").is_loopback is is_loopback


def test_the_address_for_others_is_one() -> None:
    address = address_for_others()
    assert address is None or not parse_endpoint(f"[{address}]:1").is_any


def test_ports_end_where_they_end_and_a_name_is_not_all_addresses() -> None:
    with pytest.raises(UserError, match="up to 65535"):
        parse_endpoint("tcp/h:65536")
    assert not parse_endpoint("host.example:1").is_any


@pytest.mark.parametrize("interfaces", [[], ["lo"], ["nosuch0"]])
def test_a_host_without_a_network_has_no_address_for_others(
    interfaces: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreachable(*arguments: object) -> None:
        raise OSError("Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    monkeypatch.setattr(socket, "if_nameindex", lambda: list(enumerate(interfaces)))
    assert address_for_others() is None


def test_an_address_is_followed_on_its_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    interface = OwnInterface(monkeypatch, "192.0.2.1")
    one, other = OwnAddress("192.0.2.1"), OwnAddress("192.0.2.7")
    assert (one.now, other.now) == ("192.0.2.1", None)
    for address in ("192.0.2.9", None):
        interface.address = address
        assert one.now == address


def test_all_addresses_are_followed_and_loopback_and_unknown_names_never() -> None:
    assert OwnAddress("0.0.0.0").now == address_for_others()
    assert OwnAddress("127.0.0.1").now is None
    assert OwnAddress("nobody.invalid").now is None


@pytest.mark.parametrize(
    ("text", "is_quic"),
    [("quic/h", True), ("udp/h?rel=1;mixed_rel=1", True), ("udp/h", False), ("tcp/h", False)],
)
def test_quic_has_two_names(text: str, is_quic: bool) -> None:
    assert parse_endpoint(text).is_quic is is_quic
