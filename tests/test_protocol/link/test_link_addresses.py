"""Addresses of endpoints, and who says that it is there."""

import errno
import os
import socket

import pytest
from own_interface import OwnInterface

from protocol.endpoint import Endpoint
from protocol.errors import ProtocolError
from protocol.link.endpoints import (
    Failure,
    ListenedPlaces,
    addresses_of,
    bind_reason,
    check_listening,
    resolve,
    source_address,
    why_not_reached,
)
from protocol.link.link_protection import PlainProtection
from protocol.link.messages import MAX_MESSAGE_BYTES, Hello, Role, parse_message, serialise_message
from protocol.link.presence import call_keys, parse_presence, serialise_presence, short_key
from shared_model.errors import UserError


def test_the_own_address_is_the_one_on_the_way_there() -> None:
    assert source_address(Endpoint("udp", "127.0.0.1", 7447)) == "127.0.0.1"
    assert source_address(Endpoint("udp", "::1", 7447)) in ("::1", None)
    assert source_address(Endpoint("tls", "localhost", 7447)) is None


def test_a_name_becomes_one_of_its_addresses_but_for_a_certificate() -> None:
    assert resolve(Endpoint("udp", "localhost", 7447), 0) in (
        Endpoint("udp", "127.0.0.1", 7447),
        Endpoint("udp", "::1", 7447),
    )
    assert resolve(Endpoint("tls", "localhost", 7447), 0) == Endpoint("tls", "localhost", 7447)


@pytest.mark.parametrize(
    ("host", "failure"),
    [("nobody.invalid", Failure.UNRESOLVED), ("255.255.255.255", Failure.UNREACHABLE)],
)
def test_why_there_is_no_address(host: str, failure: Failure) -> None:
    assert resolve(Endpoint("udp", host, 7447), 0) is failure


def test_no_way_leads_to_an_address_of_a_family_that_this_host_lacks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lacking = (255, socket.SOCK_DGRAM, 0, "", ("::1", 7447, 0, 0))
    monkeypatch.setattr(socket, "getaddrinfo", lambda *place, **hints: [lacking])
    assert resolve(Endpoint("tcp", "host.test", 7447), 0) is Failure.UNREACHABLE


@pytest.mark.parametrize(("role", "call"), [(Role.ENCODER, "anna"), (Role.RELAY, "")])
def test_who_is_there_is_read_as_it_was_said(role: Role, call: str) -> None:
    assert parse_presence(serialise_presence(role, call)) == (role, call)


@pytest.mark.parametrize("data", [b"", b"\x07anna", b"\x00", b"\x02anna", b"\x01a/b", bytes(300)])
def test_what_says_nobody_is_left_out(data: bytes) -> None:
    assert parse_presence(data) is None


def test_what_one_end_sends_the_other_hears() -> None:
    assert call_keys("anna", True) == tuple(reversed(call_keys("anna", False)))
    assert [short_key(key) for key in call_keys("anna", True)] == ["d", "u"]


def test_a_decoder_takes_over_the_session_of_its_encoder_alone() -> None:
    encoder, decoder = PlainProtection(b"encoder1", True), PlainProtection(b"decoder1", False)
    assert decoder.session == b"decoder1"
    assert decoder.unprotect(encoder.protect(b"frame")) is None
    decoder.on_peer(b"encoder1")
    encoder.on_peer(b"decoder1")
    assert decoder.unprotect(encoder.protect(b"frame")) == b"frame"
    assert decoder.unprotect(b"x") is None


def test_a_message_is_not_too_long_and_a_session_has_eight_bytes() -> None:
    with pytest.raises(ProtocolError, match="too long"):
        parse_message(serialise_message(Hello(Role.ENCODER, bytes(8))) + bytes(MAX_MESSAGE_BYTES))
    with pytest.raises(ValueError, match="session has 3 bytes"):
        Hello(Role.ENCODER, b"abc")


def test_an_end_may_listen_where_nobody_does() -> None:
    check_listening(["127.0.0.1:0", "udp/localhost:0", "tls/:0"])


@pytest.mark.parametrize(
    ("endpoint", "reason"),
    [
        ("203.0.113.9:7447", "this host has no such address"),
        ("udp/nowhere.invalid:7447", "its name is not known"),
    ],
)
def test_who_cannot_listen_is_told_why(endpoint: str, reason: str) -> None:
    with pytest.raises(UserError) as caught:
        check_listening([endpoint])
    assert (str(caught.value), caught.value.exit_code) == (
        f"cannot listen on {endpoint}: {reason}",
        4,
    )


@pytest.mark.parametrize(
    ("kind", "scheme"), [(socket.SOCK_STREAM, "tcp"), (socket.SOCK_DGRAM, "quic")]
)
def test_a_port_in_use_is_known_before_it_is_listened_on(
    kind: socket.SocketKind, scheme: str
) -> None:
    with socket.socket(type=kind) as holder:
        holder.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            holder.listen()
        port = holder.getsockname()[1]
        for text in (f"{scheme}/127.0.0.1:{port}", f"{scheme}/:{port}"):
            with pytest.raises(UserError, match=f"on {text}: the port is in use"):
                check_listening([text])


def test_a_refusal_without_a_word_of_ours_has_the_systems() -> None:
    assert bind_reason(OSError(errno.EACCES, "")) == os.strerror(errno.EACCES)


def test_what_an_attempt_tells_of_a_place() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        assert why_not_reached(Endpoint("tcp", "127.0.0.1", port)) is Failure.REFUSED
        holder.listen()
        assert why_not_reached(Endpoint("tcp", "127.0.0.1", port)) is Failure.FOREIGN
    nobody = why_not_reached(Endpoint("tcp", "224.0.0.1", port))
    assert nobody in (Failure.SILENT, Failure.UNREACHABLE), "TCP reaches no group"
    assert why_not_reached(Endpoint("udp", "127.0.0.1", port)) is Failure.SILENT
    assert why_not_reached(Endpoint("tcp", "nobody.invalid", port)) is Failure.UNRESOLVED


def test_where_it_is_listened_follows_the_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    interface = OwnInterface(monkeypatch, "192.0.2.1")
    listened = ListenedPlaces(["192.0.2.1:7447", "tcp/:7448", "tcp/127.0.0.1:7449"])
    interface.address = None
    assert not listened.have_moved, "it has no other one yet"
    interface.address = "192.0.2.9"
    assert listened.have_moved
    assert listened.take_over() == (
        *("udp/192.0.2.9:7447", "tcp/192.0.2.9:7447"),
        *("tcp/0.0.0.0:7448", "tcp/127.0.0.1:7449"),
    )
    assert not listened.have_moved
    listened.forget()
    assert listened.have_moved


def test_a_host_has_all_its_addresses() -> None:
    assert addresses_of(Endpoint("udp", "127.0.0.1", 7447)) == {"127.0.0.1"}
    assert addresses_of(Endpoint("udp", "nobody.invalid", 7447)) == set()
