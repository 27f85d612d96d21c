"""Interfaces of what carries a call's packets: a file or a network."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, Self

from shared_model.errors import UserError

MessageCallback = Callable[[str], None]

# Default of `LinkOptions.connect_timeout_s`.
CONNECT_TIMEOUT_S = 10.0

_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/\S+:(?P<port>\d{1,5})(\?\S*)?(#\S*)?")
MAX_PORT = 65535
_CALL_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")


def ignore_message(line: str) -> None:
    """Discard a message."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How to hold a call over a network.  Raises `UserError` if an option is invalid.

    call: its name: a-z, A-Z, 0-9 and `_.-`, no dot in front.
    listen, connect: Zenoh endpoints such as tcp/127.0.0.1:7447; at least one.
    connect_timeout_s: time limit for connecting.
    lossless: frame packets are sent reliably and wait for a slow link instead of being dropped;
        over TCP all arrive, in order, before END.  For files and measurements, not for live calls.
    router: forward the calls of others and take part in none.
    """

    call: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    lossless: bool = False
    router: bool = False

    def __post_init__(self) -> None:
        if not _CALL_NAME.fullmatch(self.call):
            raise UserError(
                f"call name {self.call!r}: use a-z, A-Z, 0-9 and _ . -, and no . in front"
            )
        if not self.listen and not self.connect:
            raise UserError("no endpoint to listen on or to connect to")
        for endpoint in self.listen + self.connect:
            parts = _ENDPOINT.fullmatch(endpoint)
            if parts is None:
                raise UserError(f"endpoint {endpoint!r}: expected something like tcp/HOST:7447")
            if int(parts["port"]) > MAX_PORT:
                raise UserError(f"endpoint {endpoint!r}: ports go up to {MAX_PORT}")
            if endpoint in self.connect and not int(parts["port"]):
                raise UserError(f"endpoint {endpoint!r}: nobody listens on port 0")


class Reachability(StrEnum):
    """Whether a packet that is sent now reaches a receiver."""

    HAS_PEER = "somebody"
    NO_PEER = "nobody"
    NO_LINK = "no link"


class PacketSink(Protocol):
    """Takes the packets of one call in order.

    reachability: of the newest packet.
    """

    @property
    def reachability(self) -> Reachability: ...

    def send(self, packet: bytes) -> None:
        """Send one serialised packet."""

    def close(self) -> None:
        """Finish; packets sent before are stored or delivered."""

    def __enter__(self) -> Self:
        """Return the sink, which is closed on leaving the block."""

    def __exit__(self, *exception: object) -> None:
        """Close."""


class PacketSource(Protocol):
    """Yields the serialised packets of one call in order.

    complete: the END packet has been returned.
    ended: no further packet will be returned.
    """

    @property
    def complete(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """The next packet, waiting at most `timeout_s`; None on timeout, or if `ended`."""

    def __iter__(self) -> Iterator[bytes]:
        """All packets until `ended`."""

    def close(self) -> None:
        """Close the file or the network connection."""

    def __enter__(self) -> Self:
        """Return the source, which is closed on leaving the block."""

    def __exit__(self, *exception: object) -> None:
        """Close."""
