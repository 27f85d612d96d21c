"""The address of an endpoint, and why nobody could be reached there."""

import socket
from dataclasses import replace
from enum import StrEnum
from ipaddress import ip_address

from protocol.endpoint import DEFAULT_SCHEMES, Endpoint


class Failure(StrEnum):
    """Why a connection could not be opened."""

    UNRESOLVED = "its name is not known"
    UNREACHABLE = "no way leads there"
    REFUSED = "nobody listens there"
    SILENT = "no answer"


def resolve(endpoint: Endpoint, turn: int) -> Endpoint | Failure:
    """The endpoint with one of its host's addresses, another one each turn.

    A name stays where it is checked against a certificate.  Nothing is sent but to a name server.
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
