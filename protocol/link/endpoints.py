"""The address of an endpoint, and why nobody could be reached there, or listen."""

import errno
import os
import socket
from collections.abc import Iterable
from dataclasses import replace
from enum import StrEnum
from ipaddress import ip_address
from typing import Any

from protocol.endpoint import DEFAULT_SCHEMES, Endpoint, OwnAddress, parse_endpoint
from shared_model.errors import LINK_FAILED, UserError

DATAGRAM_SCHEMES = ("udp", "quic")
# How long an attempt over TCP may take.
PROBE_S = 1.0


class Failure(StrEnum):
    """Why a connection could not be opened."""

    UNRESOLVED = "its name is not known"
    UNREACHABLE = "no way leads there"
    REFUSED = "nobody listens there"
    SILENT = "no answer"
    FOREIGN = (
        "what listens there does not speak this protocol"
        " (a relay with certificates: --connect tls/HOST:PORT --keys FILE)"
    )


def resolve(endpoint: Endpoint, turn: int) -> Endpoint | Failure:
    """The endpoint with an address of its host; each turn takes the next address.

    A name that is checked against a certificate stays.  Nothing is sent but to a name server.
    """
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        return Failure.UNRESOLVED
    family, kind, protocol, _, address = found[turn % len(found)]
    try:
        # This host may not know the family at all.
        with socket.socket(family, kind, protocol) as probe:
            # This sends nothing, it asks for the way.
            probe.connect(address)
    except OSError:
        return Failure.UNREACHABLE
    if endpoint.scheme in DEFAULT_SCHEMES:
        return replace(endpoint, host=str(address[0]))
    return endpoint


def addresses_of(endpoint: Endpoint) -> set[str]:
    """All addresses of an endpoint's host; none if they are not known."""
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        return set()
    return {str(address[0]) for *_, address in found}


def why_not_reached(endpoint: Endpoint) -> Failure:
    """Why no call can be had at an endpoint, as far as an attempt over TCP tells."""
    resolved = resolve(endpoint, 0)
    if isinstance(resolved, Failure):
        return resolved
    if endpoint.scheme in DATAGRAM_SCHEMES:
        return Failure.SILENT
    try:
        socket.create_connection((resolved.host, resolved.port), PROBE_S).close()
    except ConnectionRefusedError:
        return Failure.REFUSED
    except OSError:
        return Failure.SILENT
    return Failure.FOREIGN


def source_address(endpoint: Endpoint) -> str | None:
    """The own address on the way to an endpoint; None: no way leads there, or it has a name.

    Nothing is sent.
    """
    try:
        family = socket.AF_INET6 if ip_address(endpoint.host).version == 6 else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((endpoint.host, endpoint.port))
            return str(probe.getsockname()[0])
    except (OSError, ValueError):
        return None


class ListenedPlaces:
    """Where an end listens, while the addresses of this host change.

    An endpoint with one address goes where the network interface goes that has it at first; one on
    all addresses, or on loopback, stays.
    """

    def __init__(self, endpoints: Iterable[str]) -> None:
        self._places = [place for text in endpoints for place in parse_endpoint(text).choices]
        self._owns = [
            None if place.is_any or place.is_loopback else OwnAddress(place.host)
            for place in self._places
        ]
        self._known: list[str | None] = [None] * len(self._places)
        self._known = self._addresses()

    @property
    def have_moved(self) -> bool:
        """Whether an address that is listened on has been replaced."""
        return self._addresses() != self._known

    def take_over(self) -> tuple[str, ...]:
        """What Zenoh listens on from now on."""
        self._known = self._addresses()
        places = [
            place if address is None else replace(place, host=address)
            for place, address in zip(self._places, self._known, strict=True)
        ]
        return tuple(locator for place in places for locator in place.locators)

    def forget(self) -> None:
        """Forget the addresses, since listening has failed there; they are looked up again."""
        self._known = [None] * len(self._places)

    def _addresses(self) -> list[str | None]:
        """The address of each endpoint; one that is gone for the moment is as it was."""
        now = [None if own is None else own.now for own in self._owns]
        return [new or old for new, old in zip(now, self._known, strict=True)]


def check_listening(endpoints: Iterable[str]) -> None:
    """Raise `UserError` with exit code 4 if an end could not listen on one of the endpoints."""
    for text in endpoints:
        for place in parse_endpoint(text).choices:
            if place.is_device:
                continue
            kind = socket.SOCK_DGRAM if place.scheme in DATAGRAM_SCHEMES else socket.SOCK_STREAM
            reason = why_not_bound(place.host, place.port, kind)
            if reason is not None:
                raise UserError(f"cannot listen on {text}: {reason}", LINK_FAILED)


def why_not_bound(host: str, port: int, kind: socket.SocketKind) -> str | None:
    """Why no socket of this kind can have an address of this host; None: one can."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError):
        return Failure.UNRESOLVED
    reasons = [_bind_refusal(family, kind, address) for family, _, _, _, address in found]
    return None if None in reasons else reasons[0]


def bind_reason(error: OSError) -> str:
    """Why a socket could not have an address."""
    number = error.errno or 0
    known = {
        errno.EADDRINUSE: "the port is in use",
        errno.EADDRNOTAVAIL: "this host has no such address",
    }
    return known.get(number, os.strerror(number))


def _bind_refusal(family: int, kind: socket.SocketKind, address: Any) -> str | None:
    try:
        with socket.socket(family, kind) as probe:
            if kind == socket.SOCK_STREAM:
                # A connection that has just ended does not keep the port.
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return bind_reason(error)
    return None
