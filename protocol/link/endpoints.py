"""Where an end of a link listens or connects to, one transport at a time."""

import socket
from dataclasses import dataclass
from enum import StrEnum

from protocol.endpoint import DEFAULT_SCHEMES, parse_endpoint, parse_remote_endpoint


class Failure(StrEnum):
    """Why a connection could not be opened."""

    UNRESOLVED = "its name is not known"
    UNREACHABLE = "no way leads there"
    REFUSED = "nobody listens there"
    SILENT = "no answer"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One endpoint of Zenoh.  tail: its options, as Zenoh takes them."""

    scheme: str
    host: str
    port: int
    tail: str = ""

    @property
    def is_reliable(self) -> bool:
        """Whether nothing is lost on the way and the set-up repeats itself."""
        return self.scheme != "udp" or "rel=1" in self.tail

    def at(self, host: str) -> str:
        """The endpoint with another host, for Zenoh."""
        bracketed = f"[{host}]" if ":" in host and not host.startswith("[") else host
        return f"{self.scheme}/{bracketed}:{self.port}{self.tail}"

    def __str__(self) -> str:
        return self.at(self.host)


def link_endpoints(text: str, listens: bool) -> tuple[Endpoint, ...]:
    """The endpoints that `text` stands for, the best first; see `protocol.endpoint`.

    Raises `UserError`.
    """
    place = parse_endpoint(text) if listens else parse_remote_endpoint(text)
    schemes = DEFAULT_SCHEMES if place.scheme is None else (place.scheme,)
    return tuple(Endpoint(scheme, place.host, place.port, place.options) for scheme in schemes)


def resolve(endpoint: Endpoint, turn: int) -> tuple[str, Failure | None]:
    """The endpoint with one of its host's addresses, another one each turn.

    A name stays where it is checked against a certificate.  Nothing is sent but to a name server.
    """
    host = endpoint.host.strip("[]")
    try:
        found = socket.getaddrinfo(host, endpoint.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        return "", Failure.UNRESOLVED
    family, kind, protocol, _, address = found[turn % len(found)]
    with socket.socket(family, kind, protocol) as probe:
        try:
            # This sends nothing, it asks for the way.
            probe.connect(address)
        except OSError:
            return "", Failure.UNREACHABLE
    if endpoint.scheme in DEFAULT_SCHEMES:
        return endpoint.at(str(address[0])), None
    return str(endpoint), None
