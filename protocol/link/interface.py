"""What carries the packets of a call, a file or a network: the same to both ends."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, Self

from shared_model.errors import UserError

MessageCallback = Callable[[str], None]

# For how long to try to connect, if nobody says.
CONNECT_TIMEOUT_S = 10.0

_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/\S+:(?P<port>\d{1,5})(\?\S*)?(#\S*)?")
MAX_PORT = 65535
_CALL_NAME = re.compile(r"[A-Za-z0-9_.-]+")


def ignore_message(line: str) -> None:
    """Say nothing."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Where and how to hold a call over a network.  Raises `UserError` if that cannot be.

    call: its name, letters, digits and `_.-`.
    listen, connect: Zenoh endpoints such as tcp/127.0.0.1:7447; at least one.
    connect_timeout_s: for how long to try to connect.
    lossless: frames are sent reliably and wait for a slow link rather than being dropped; over TCP
        all arrive, in order, before END.  For files and measurements, not for live calls.
    router: pass on what others send rather than take part.
    """

    call: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    lossless: bool = False
    router: bool = False

    def __post_init__(self) -> None:
        if not _CALL_NAME.fullmatch(self.call):
            raise UserError(f"call name {self.call!r}: use letters, digits and _ . - only")
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
    """Whom a packet can reach."""

    HAS_PEER = "somebody"
    NO_PEER = "nobody"
    NO_LINK = "no link"


class PacketSink(Protocol):
    """Takes the packets of one call in order.

    reach: whom the newest packet could reach.
    """

    @property
    def reachability(self) -> Reachability: ...

    def send(self, packet: bytes) -> None:
        """Pass on one serialised packet."""

    def close(self) -> None:
        """Finish; what was sent is kept or delivered."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block, whatever happened in it."""

    def __exit__(self, *exception: object) -> None:
        """Close."""


class PacketSource(Protocol):
    """Yields the packets of one call in order, unparsed.

    complete: the END packet has been handed out.
    ended: nothing more will come.
    """

    @property
    def complete(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """The next packet, waiting at most `timeout_s`; None if none came in time or `ended`."""

    def __iter__(self) -> Iterator[bytes]:
        """All packets until `ended`."""

    def close(self) -> None:
        """Let go of the file or the network."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block."""

    def __exit__(self, *exception: object) -> None:
        """Close."""
