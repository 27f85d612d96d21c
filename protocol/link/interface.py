"""Interfaces of what carries a call's packets: a file or a network."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol, Self

from protocol.endpoint import Endpoint, parse_endpoint, parse_remote_endpoint
from protocol.limits import CALL_NAME, CALL_NAME_RULE
from protocol.security.link_security import LinkSecurity
from shared_model.errors import UserError

MessageCallback = Callable[[str], None]

# Python handles Ctrl-C between two waits: the signal may be delivered to a thread of Zenoh.
POLL_S = 0.1
# Default of `LinkOptions.connect_timeout_s`.
CONNECT_TIMEOUT_S = 10.0
# Bytes that Zenoh adds to a frame packet from an end that listens or a relay, measured with 8-bit
# sequence numbers; an end that connects also spells the key out, with one byte for its length: two
# bytes to the other end, more to a relay.
ZENOH_OVERHEAD_BYTES = {"udp": 6, "tcp": 8}
# Bytes of the headers of IP (20) and UDP (8), or TCP with timestamps (32).
IP_OVERHEAD_BYTES = {"udp": 28, "tcp": 52}


def ignore_message(line: str) -> None:
    """Discard a message."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How to hold a call over a network.  Raises `UserError` if an option is invalid.

    call: its name: a-z, A-Z, 0-9 and `_.-`, no dot in front.
    listen, connect: endpoints, see `protocol.endpoint`; at least one.
    connect_timeout_s: time limit for connecting.
    lossless: frame packets are sent again until they are there: all arrive, in order, before END.
        For files and measurements, not for live calls.
    security: what protects the call.
    rate_bps: what the link of an encoder carries, where that is known; None: it is measured before
        the call begins, which takes a thin link seconds.
    """

    call: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    lossless: bool = False
    security: LinkSecurity = field(default_factory=LinkSecurity)
    rate_bps: float | None = None

    def __post_init__(self) -> None:
        if not CALL_NAME.fullmatch(self.call):
            raise UserError(f"call name {self.call!r}: {CALL_NAME_RULE}")
        if not self.listen_locators and not self.connect_endpoints:
            raise UserError("no endpoint to listen on or to connect to")

    @property
    def listen_locators(self) -> tuple[str, ...]:
        """What Zenoh listens on."""
        return tuple(each for text in self.listen for each in parse_endpoint(text).locators)

    @property
    def connect_endpoints(self) -> tuple[tuple[Endpoint, ...], ...]:
        """For each place to connect to its endpoints, the best first."""
        return tuple(parse_remote_endpoint(text).choices for text in self.connect)


@dataclass(frozen=True, slots=True)
class Arrival:
    """A serialised packet as a source returns it.

    time_s: `time.monotonic` when it arrived, or was read from a file.
    session: 0 for the first start of the encoder that this source has heard, one more after each
        restart of the encoder; 0 for a file.
    number: of a frame packet its full number in the session, from 0; of a model packet that of the
        first frame packet coded by it; of a control packet that of the frame packet after it.
        None if the source does not know it: then the packet's own 6 bits have to do.
    """

    data: bytes
    time_s: float
    session: int = 0
    number: int | None = None


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """What the sender of a call knows of its link.

    loss: share of the frame packets that did not arrive the first time, 0..1, of late.
    round_trip_s: None before it has been measured, and for files.
    rate_bps: what the link carries, bits per second with the headers of IP, as far as it has been
        tried; None before it has been measured, and for files.
    """

    loss: float = 0.0
    round_trip_s: float | None = None
    rate_bps: float | None = None


class PacketProtection(Protocol):
    """Guards each payload of a link against change; with keys also against reading and forging.

    The payloads of a link are packets of a call and messages of the link.  A HELLO message is
    the first that an end sends; it carries `session`, and the other end's once that is known.
    session: 8 random bytes that this end has drawn when it started.
    """

    @property
    def session(self) -> bytes: ...

    def protect(self, data: bytes) -> bytes:
        """The payload to send for `data`; a repetition is protected again."""

    def unprotect(self, data: bytes) -> bytes | None:
        """What the other end protected; None: not from this call, or changed on the way."""

    def on_peer(self, session: bytes) -> None:
        """The other end is in this session: its HELLO has echoed ours."""


class Reachability(StrEnum):
    """Whether a packet that is sent now reaches a receiver; BUSY: that has another encoder."""

    HAS_PEER = "somebody"
    NO_PEER = "nobody"
    BUSY = "busy"
    NO_LINK = "no link"


class PacketSink(Protocol):
    """Takes the packets of one call in order.

    What stores them takes each, and loses nothing.
    """

    @property
    def reachability(self) -> Reachability:
        """Whether the newest packet reaches a receiver."""
        return Reachability.HAS_PEER

    @property
    def quality(self) -> LinkQuality:
        """Of the link at the moment."""
        return LinkQuality()

    def wait_for_peer(self, timeout_s: float) -> None:
        """Wait for a decoder: nobody is waited for where packets are stored."""
        return

    def send(self, packet: bytes) -> None:
        """Send one serialised packet."""

    def close(self) -> None:
        """Finish; packets sent before are stored or delivered."""

    def __enter__(self) -> Self:
        """Return the sink, which is closed on leaving the block."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close."""
        self.close()


class PacketSource(Protocol):
    """Yields the serialised packets of one call.

    Over a lossy link frame packets may be missing, and one that was lost and sent again is late:
    it comes after frame packets with higher numbers, and never twice.
    complete: the END packet has been returned.
    ended: no further packet will be returned.
    """

    @property
    def complete(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        """The next packet, waiting at most `timeout_s`; None on timeout, or if `ended`."""

    def __iter__(self) -> Iterator[bytes]:
        """The bytes of all packets until `ended`."""
        while (arrival := self.receive()) is not None:
            yield arrival.data

    def close(self) -> None:
        """Close the file or the network connection."""

    def __enter__(self) -> Self:
        """Return the source, which is closed on leaving the block."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close."""
        self.close()
