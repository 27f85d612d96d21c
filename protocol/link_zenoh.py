"""A call over Zenoh: the only file that imports it.

Keys: risorius/CALL/model (published, and queryable with the layers for who joins late),
risorius/CALL/layer, risorius/CALL/frame and risorius/CALL/control.  Each end keeps a liveliness
token, so that the other knows when it comes and goes.  Nothing is found by multicast: one end
listens where the other connects, or both connect to a router.
"""

import _thread
import json
import re
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Self

import zenoh
from zenoh import CongestionControl, ConsolidationMode, Reliability, SampleKind
from zenoh.handlers import Callback

from protocol.arrivals import Arrivals
from protocol.kept import Kept
from protocol.messages import (
    MAX_MODEL_PACKET_BYTES,
    Kind,
    is_end,
    packet_kind,
)
from shared_model.errors import UserError

LINK_FAILED = 4
# Bytes that a live frame packet grows by, measured with 8-bit sequence numbers and declared keys:
# under UDP, under TCP; then what IP adds (20 and 8 of UDP, 20 and 32 of TCP with timestamps).
ZENOH_OVERHEAD_BYTES = {"udp": 6, "tcp": 8}
IP_OVERHEAD_BYTES = {"udp": 28, "tcp": 52}
# For how long a call without END waits for its encoder to come back.
GONE_GRACE_S = 1.0
# How long a session that nobody wants any more may take to open.
OPENING_S = 0.5

_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/\S+:\d+(\?\S*)?(#\S*)?")
_CALL_NAME = re.compile(r"[A-Za-z0-9_.-]+")


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Where and how to hold a call.

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
    connect_timeout_s: float = 10.0
    lossless: bool = False
    router: bool = False

    def __post_init__(self) -> None:
        if not _CALL_NAME.fullmatch(self.call):
            raise UserError(f"call name {self.call!r}: use letters, digits and _ . - only")
        if not self.listen and not self.connect:
            raise UserError("no endpoint to listen on or to connect to")
        for endpoint in self.listen + self.connect:
            if not _ENDPOINT.fullmatch(endpoint):
                raise UserError(f"endpoint {endpoint!r}: expected something like tcp/HOST:7447")


class _Session:
    """An open session, closed on leaving the `with` block.

    Callbacks run in the thread that receives: one of its own for each, which ends with its session
    only, would keep an interrupted program from ending.
    """

    def __init__(self, options: LinkOptions) -> None:
        self._session = _open(options)
        try:
            self._declare(options)
        except BaseException:
            self.close()
            raise

    def _declare(self, options: LinkOptions) -> None:
        """Say in the open session what this end sends and wants."""

    def close(self) -> None:
        """Deliver what was sent and leave; closing twice does nothing more."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class ZenohSink(_Session):
    """The encoder's end of a call: a `PacketSink`.

    Raises `UserError` with exit code 4 if the link cannot be made.
    """

    def __init__(self, options: LinkOptions) -> None:
        self._kept = Kept()
        self._peers = 0
        self._changed = threading.Condition()
        super().__init__(options)

    def _declare(self, options: LinkOptions) -> None:
        key = f"risorius/{options.call}"
        self._publishers = {
            kind: self._publisher(f"{key}/{kind.name.lower()}", options.lossless, kind)
            for kind in Kind
        }
        self._session.declare_queryable(f"{key}/model", Callback(self._answer, indirect=False))
        liveliness = self._session.liveliness()
        liveliness.declare_subscriber(
            f"{key}/decoder/*", Callback(self._decoder_changed, indirect=False), history=True
        )
        self._token = liveliness.declare_token(f"{key}/encoder")

    @property
    def peers(self) -> int:
        """Number of decoders that are there."""
        return self._peers

    def wait_for_peer(self, timeout_s: float) -> None:
        """Return once a decoder is there and will get all that is sent from now on.

        Raises `UserError` with exit code 4 if none has come within `timeout_s`.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self._peers > 0, timeout_s):
                raise UserError(f"no decoder came within {timeout_s:g} s", LINK_FAILED)

    def send(self, packet: bytes) -> None:
        """Publish one packet; models in use and their layers are kept for who joins later."""
        self._kept.note(packet)
        self._put(packet_kind(packet), packet)

    def _publisher(self, key: str, lossless: bool, kind: Kind) -> zenoh.Publisher:
        sure = lossless or kind is not Kind.FRAME
        return self._session.declare_publisher(
            key,
            reliability=Reliability.RELIABLE if sure else Reliability.BEST_EFFORT,
            congestion_control=CongestionControl.BLOCK if sure else CongestionControl.DROP,
            # Holding packets back for a batch gains nothing at thirty a second, but saying so costs
            # two bytes each, and an idle link sends a live frame at once anyway.
            express=sure,
        )

    def _put(self, kind: Kind, packet: bytes) -> None:
        try:
            self._publishers[kind].put(packet)
        except zenoh.ZError as error:
            raise UserError(f"the link has failed: {_reason(error)}", LINK_FAILED) from error

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            for packet in self._kept.packets:
                query.reply(query.key_expr, packet)

    def _decoder_changed(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self._peers += 1 if sample.kind == SampleKind.PUT else -1
            self._changed.notify_all()


class ZenohSource(_Session):
    """The decoder's end of a call: a `PacketSource`.

    Hands out the model before any frame, whenever it joins.  Ends with the END packet, or when the
    encoder has been gone for `gone_grace_s` without one, and nothing has come for as long: a slow
    link goes on delivering.
    Raises `UserError` with exit code 4 if the link cannot be made.
    """

    def __init__(self, options: LinkOptions, gone_grace_s: float = GONE_GRACE_S) -> None:
        self._grace_s = gone_grace_s
        self._arrivals = Arrivals()
        self._gone_s: float | None = None
        self._last_s = monotonic()  # when something arrived
        self._complete = self._ended = False
        self._key = f"risorius/{options.call}"
        super().__init__(options)

    def _declare(self, options: LinkOptions) -> None:
        # With a thread for each key, packets would change places.
        arrived = Callback(self._arrived, indirect=False)
        for kind in Kind:
            self._session.declare_subscriber(f"{self._key}/{kind.name.lower()}", arrived)
        liveliness = self._session.liveliness()
        liveliness.declare_subscriber(
            f"{self._key}/encoder", Callback(self._encoder_changed, indirect=False), history=True
        )
        # After the subscribers: who sees the token knows that they are there.
        self._token = liveliness.declare_token(f"{self._key}/decoder/{self._session.zid()}")

    @property
    def complete(self) -> bool:
        """The END packet has been handed out."""
        return self._complete

    @property
    def ended(self) -> bool:
        """Nothing more will come."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """The next packet, waiting at most `timeout_s`; None if none came in time or `ended`."""
        deadline = None if timeout_s is None else monotonic() + timeout_s
        while not self._ended:
            packet = self._arrivals.take(self._patience_s(deadline))
            if packet is not None:
                self._complete = self._ended = is_end(packet)
                return packet
            now, end = monotonic(), self._end_s
            self._ended = end is not None and now >= end
            if deadline is not None and now >= deadline:
                break
        return None

    def __iter__(self) -> Iterator[bytes]:
        while (packet := self.receive()) is not None:
            yield packet

    def _patience_s(self, deadline: float | None) -> float | None:
        ends = [deadline, self._end_s]
        return min((max(0.0, end - monotonic()) for end in ends if end is not None), default=None)

    @property
    def _end_s(self) -> float | None:
        """When to wait no longer for an encoder that is gone."""
        gone_s = self._gone_s
        return None if gone_s is None else max(gone_s, self._last_s) + self._grace_s

    def _arrived(self, sample: zenoh.Sample) -> None:
        self._last_s = monotonic()
        self._arrivals.put(sample.payload.to_bytes())

    def _encoder_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == SampleKind.PUT:
            self._gone_s = None
            # The model may have been published before we came; if also after, one is dropped.
            self._session.get(
                f"{self._key}/model",
                Callback(self._replied, indirect=False),
                consolidation=ConsolidationMode.NONE,
            )
        else:
            self._gone_s = monotonic()
            self._arrivals.wake()

    def _replied(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._arrivals.put(reply.ok.payload.to_bytes())


class ZenohRouter(_Session):
    """Passes calls on between ends that connect to it, until it is closed.

    Raises `UserError` with exit code 4 if it cannot listen.
    """

    def __init__(self, listen: tuple[str, ...]) -> None:
        super().__init__(LinkOptions("any", listen, router=True))


def _open(options: LinkOptions) -> zenoh.Session:
    """A session, opened in a thread of its own so that Ctrl-C need not wait for it."""
    results: list[zenoh.Session | zenoh.ZError] = []
    done: SimpleQueue[None] = SimpleQueue()

    def run() -> None:
        try:
            results.append(zenoh.open(_config(options)))
        except zenoh.ZError as error:
            results.append(error)
        done.put(None)

    # An interrupt within `threading.Thread.start` is not always one outside of it.
    _thread.start_new_thread(run, ())
    try:
        done.get()
    except BaseException:
        # Python aborts if a thread comes back from Zenoh while it ends; one that listens does soon.
        if not results:
            with suppress(Empty):
                done.get(timeout=OPENING_S)
        raise
    (result,) = results
    if isinstance(result, zenoh.ZError):
        raise UserError(_open_failure(options, _reason(result)), LINK_FAILED) from result
    return result


def _config(options: LinkOptions) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        # Routers pass packets on between clients, not between peers that do not gossip.
        "mode": "router" if options.router else "peer" if options.listen else "client",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": options.listen,
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": options.connect,
        "connect/timeout_ms": round(1000 * options.connect_timeout_s),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 1000,
            "period_increase_factor": 1.5,
        },
        # One byte of sequence number in every message instead of up to five.
        "transport/link/tx/sequence_number_resolution": "8bit",
        "transport/link/rx/max_message_size": 2 * MAX_MODEL_PACKET_BYTES,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _open_failure(options: LinkOptions, reason: str) -> str:
    if "Unable to connect" in reason:
        where = " or ".join(options.connect)
        return f"cannot reach {where} within {options.connect_timeout_s:g} s; is anyone there?"
    where = " and ".join(options.listen)
    if "Address already in use" in reason:
        return f"cannot listen on {where}: the port is in use, choose another"
    return f"cannot listen on {where}: {reason}"


def _reason(error: zenoh.ZError) -> str:
    """Zenoh's message without the place in its sources."""
    return re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))
