"""A relay: Zenoh's router, bounded in what peers can make it hold."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

import zenoh
from zenoh import CongestionControl

from protocol.endpoint import CERTIFIED_SCHEMES, Endpoint, parse_endpoint, parse_remote_endpoint
from protocol.errors import ProtocolError
from protocol.limits import CALL_NAME, RELAY_PEERS
from protocol.link.endpoints import check_listening, why_not_reached
from protocol.link.messages import Role
from protocol.link.presence import call_keys, page_key, page_of
from protocol.link.zenoh_session import answer_who_is_there, reason, zenoh_config
from protocol.link.zenoh_settings import MAX_MESSAGE_BYTES
from protocol.relay.access import access_control
from protocol.security.authority import InvitedPeer
from protocol.security.link_security import KeyFile, tls_settings
from shared_model.errors import LINK_FAILED, UserError

# Connections that are being opened at a time, and for how long each may take to.
MAX_PENDING, OPEN_TIMEOUT_MS = 100, 5000
# What waits for a slow peer, in batches of each priority; more is dropped.
QUEUED_BATCHES = 4
_PRIORITIES = (
    "control",
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)
# How long a relay may take to answer.
QUERY_TIMEOUT_S = 5.0
# After what silence a peer is gone.
LEASE_MS = 10_000


@dataclass(frozen=True, slots=True)
class RelayOptions:
    """listen, connect: endpoints, see `parse_endpoint`; connect: of other relays.

    max_peers: connections at a time.
    keys: what the relay shows, for mutual TLS; None: without.
    peers: who was invited, with `keys`; None: everybody may do everything.
    Raises `UserError` if somebody without a certificate could connect although there are keys.
    """

    listen: tuple[str, ...]
    connect: tuple[str, ...] = ()
    max_peers: int = RELAY_PEERS
    keys: KeyFile | None = None
    peers: tuple[InvitedPeer, ...] | None = None

    def __post_init__(self) -> None:
        if self.keys is not None:
            check_certified(self.listen + self.connect)


def check_certified(endpoints: Sequence[str]) -> None:
    """Raise `UserError` if somebody without a certificate could connect there."""
    for text in endpoints:
        if parse_endpoint(text).scheme not in CERTIFIED_SCHEMES:
            raise UserError(f"endpoint {text!r}: with keys use tls/HOST:PORT or quic/HOST:PORT")


class Relay:
    """Forwards calls between the ends that connect to it, until it is closed.

    Raises `UserError` with exit code 4 if it cannot listen.
    """

    def __init__(self, options: RelayOptions) -> None:
        try:
            self._session = zenoh.open(zenoh_config(relay_settings(options)))
        except zenoh.ZError as error:
            check_listening(options.listen)
            where = " and ".join(options.listen)
            raise UserError(f"cannot listen on {where}: {reason(error)}", LINK_FAILED) from error
        answer_who_is_there(self._session, Role.RELAY, "")

    def watch(self, call: str, receive: Callable[[bytes, str], None]) -> "WatchedCall":
        """What an encoder of a call sends, as decoders of it get it.

        receive: called with each payload and the page that it is for ("": all), in a thread of
            Zenoh.
        """
        return WatchedCall(self._session, call, receive)

    def close(self) -> None:
        """Leave; closing twice has no further effect."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class WatchedCall:
    """A call at a relay whose payloads go on to pages, which are no peers of Zenoh."""

    def __init__(
        self, session: zenoh.Session, call: str, receive: Callable[[bytes, str], None]
    ) -> None:
        self._sent_key, heard_key = call_keys(call, is_encoder=False)
        self._session = session

        def take(sample: zenoh.Sample) -> None:
            receive(sample.payload.to_bytes(), page_of(str(sample.key_expr)))

        keys = heard_key, page_key(heard_key, "*")
        self._subscribers = [session.declare_subscriber(key, take) for key in keys]

    def send(self, payload: bytes, page: str) -> None:
        """Send a payload of a page to the encoder."""
        key = page_key(self._sent_key, page)
        with suppress(zenoh.ZError):
            self._session.put(key, payload, congestion_control=CongestionControl.DROP, express=True)

    def close(self) -> None:
        """Receive no more."""
        for subscriber in self._subscribers:
            with suppress(zenoh.ZError):
                subscriber.undeclare()  # type: ignore[no-untyped-call]


def relay_settings(options: RelayOptions) -> Mapping[str, Any]:
    """Zenoh's settings for a relay, by name."""
    listen = [place for text in options.listen for place in parse_endpoint(text).locators]
    connect = [_join(parse_remote_endpoint(text)).locators[0] for text in options.connect]
    settings: dict[str, Any] = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": listen,
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": connect,
        # Another relay may start later, and come back.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        # Its own list of subscriptions, which tells the calls.
        "adminspace/enabled": True,
        "adminspace/permissions": {"read": True, "write": False},
        "transport/unicast/max_sessions": options.max_peers,
        "transport/unicast/accept_pending": MAX_PENDING,
        "transport/unicast/accept_timeout": OPEN_TIMEOUT_MS,
        "transport/link/tx/lease": LEASE_MS,
        # Sequence numbers of one byte instead of up to five.
        "transport/link/tx/sequence_number_resolution": "8bit",
        "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, QUEUED_BATCHES),
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
    }
    if options.keys is not None:
        settings["transport/link/tls"] = tls_settings(options.keys)
    if options.peers is not None:
        settings["access_control"] = access_control(options.peers)
    return settings


def _join(place: Endpoint) -> Endpoint:
    """Where to join another relay: reliably unless it is asked for otherwise."""
    return next((each for each in place.choices if each.is_reliable), place)


@dataclass(frozen=True, slots=True)
class RelayedCall:
    """A call at a relay, and how many of its ends are connected to it."""

    name: str
    encoders: int
    decoders: int


def calls_at_relay(
    endpoint: str, keys: KeyFile | None, timeout_s: float = QUERY_TIMEOUT_S
) -> list[RelayedCall]:
    """The calls at the relay that listens at `endpoint`, in the order of their names.

    keys: to show, for TLS.  Raises `UserError` with exit code 4 if it cannot be reached, no relay
    answers, or one that says something else.
    """
    settings: dict[str, Any] = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": parse_remote_endpoint(endpoint).locators,
        "connect/timeout_ms": round(1000 * timeout_s),
        "connect/exit_on_failure": True,
    }
    if keys is not None:
        settings["transport/link/tls"] = tls_settings(keys)
    try:
        with zenoh.open(zenoh_config(settings)) as session:
            relay = str(next(iter(session.info.routers_zid()), ""))
            if not relay:
                raise UserError(f"{endpoint} is no relay", LINK_FAILED)
            counts: dict[str, dict[str, int]] = {}
            replies = session.get(f"@/{relay}/router/subscriber/**", timeout=timeout_s)
            for sample in filter(None, [reply.ok for reply in replies]):
                _count(counts, str(sample.key_expr), sample.payload.to_bytes())
    except ProtocolError as error:
        raise UserError(f"cannot read the calls at {endpoint}: {error}", LINK_FAILED) from error
    except zenoh.ZError as error:
        why = why_not_reached(parse_remote_endpoint(endpoint).choices[-1])
        raise UserError(f"cannot reach {endpoint}: {why}", LINK_FAILED) from error
    return [
        RelayedCall(name, ends.get("encoder", 0), ends.get("decoder", 0))
        for name, ends in sorted(counts.items())
    ]


def _count(counts: dict[str, dict[str, int]], key: str, payload: bytes) -> None:
    """Note how many have subscribed to a key: encoders to what goes up, decoders to the rest."""
    subscribed = key.partition("/subscriber/")[2]
    name = subscribed.partition("/")[2]
    for end, is_encoder in (("encoder", True), ("decoder", False)):
        if CALL_NAME.fullmatch(name) and subscribed == call_keys(name, is_encoder)[1]:
            counts.setdefault(name, {})[end] = subscriber_count(payload)


def subscriber_count(payload: bytes) -> int:
    """How many have subscribed to a key, as a Zenoh router says it of itself.

    Raises `ProtocolError` if it says something else.
    """
    try:
        ends = json.loads(payload)
    except ValueError as error:
        raise ProtocolError("its list of subscribers is no JSON") from error
    kinds = [ends.get(kind) for kind in ("clients", "peers")] if isinstance(ends, dict) else []
    lists = [each for each in kinds if isinstance(each, list)]
    if len(lists) != 2:
        raise ProtocolError("its list of subscribers names no clients and peers")
    return sum(map(len, lists))
