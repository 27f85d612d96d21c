"""A call over Zenoh: the only file that imports it.

Keys: risorius/CALL/model (published; a late joiner queries it for models and layers),
risorius/CALL/layer, risorius/CALL/frame and risorius/CALL/control.  Each end declares a liveliness
token, which tells the other end when it joins and leaves.  Multicast discovery is off: one end
listens and the other connects to it, or both connect to a router.
"""

import _thread
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import Self

import zenoh
from zenoh import CongestionControl, ConsolidationMode, Reliability, SampleKind
from zenoh.handlers import Callback

from protocol.limits import MAX_MODEL_PACKET_BYTES
from protocol.link.interface import (
    Arrival,
    LinkOptions,
    LinkQuality,
    MessageCallback,
    Reachability,
    ignore_message,
)
from protocol.link.model_cache import ModelCache
from protocol.link.peers import POLL_S, PeerMonitor
from protocol.link.receive_queue import ReceiveQueue
from protocol.packets import PacketKind, is_end, packet_kind
from shared_model.errors import LINK_FAILED, UserError

# Bytes that Zenoh adds to a live frame packet, measured with 8-bit sequence numbers and declared
# keys; bytes of the headers of IP (20) and UDP (8), or TCP with timestamps (32).
ZENOH_OVERHEAD_BYTES = {"udp": 6, "tcp": 8}
IP_OVERHEAD_BYTES = {"udp": 28, "tcp": 52}
# Time that a call without END waits for its encoder to return.
LEAVE_GRACE_S = 1.0
# Time that an interrupted program waits for a session that is being opened.
OPENING_S = 0.5


class _Session:
    """An open session, closed on leaving the `with` block.

    Callbacks run in Zenoh's receiving thread.  With a thread of its own for each callback, which
    lives as long as the session, an interrupted program could not end.
    """

    def __init__(
        self, options: LinkOptions, waiting_for: str = "", say: MessageCallback = ignore_message
    ) -> None:
        """waiting_for: the other end, as the message about connecting or listening names it."""
        if not options.listen:
            say(f"connecting to {' or '.join(options.connect)} for {waiting_for}")
        self._session = _open(options)
        try:
            if options.listen:
                say(f"listening on {' and '.join(options.listen)} for {waiting_for}")
            self._declare(options)
        except BaseException:
            self.close()
            raise

    def _declare(self, options: LinkOptions) -> None:
        """Declare what this end sends and receives."""

    def close(self) -> None:
        """Deliver what was sent and leave; closing twice has no further effect."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class ZenohSink(_Session):
    """The encoder's end of a call: a `PacketSink`.  Zenoh reconnects it by itself.

    say: called with a line when it waits for a decoder, when the last decoder has left, and when
        one has joined again.
    Raises `UserError` with exit code 4 if the link cannot be made or another encoder has the same
    call; two encoders that start at the same moment may not notice each other.
    """

    def __init__(self, options: LinkOptions, say: MessageCallback = ignore_message) -> None:
        self._models = ModelCache()
        self._decoders = PeerMonitor(say)
        self._reachability = Reachability.NO_PEER
        self._listens = bool(options.listen)
        self._begun_s = monotonic()
        super().__init__(options, f"a decoder of call {options.call!r}", say)

    def _declare(self, options: LinkOptions) -> None:
        key = f"risorius/{options.call}"
        if self._name_is_taken(f"{key}/encoder"):
            raise UserError(
                f"call {options.call!r} has an encoder already; choose another name with --call",
                LINK_FAILED,
            )
        self._publishers = {
            kind: self._publisher(f"{key}/{kind.name.lower()}", options.lossless, kind)
            for kind in PacketKind
        }
        self._session.declare_queryable(f"{key}/model", Callback(self._answer, indirect=False))
        liveliness = self._session.liveliness()
        liveliness.declare_subscriber(
            f"{key}/decoder/*", Callback(self._decoder_changed, indirect=False), history=True
        )
        self._token = liveliness.declare_token(f"{key}/encoder")

    @property
    def peers(self) -> int:
        """Number of decoders present."""
        return len(self._decoders)

    @property
    def reachability(self) -> Reachability:
        """Reachability of the newest packet; an encoder that listens always has a link."""
        return self._reachability

    @property
    def quality(self) -> LinkQuality:
        """Nothing is measured."""
        return LinkQuality()

    def wait_for_peer(self, timeout_s: float) -> None:
        """Wait for a decoder, which then receives all packets sent from now on.

        timeout_s: from the construction of the sink.
        Raises `UserError` with exit code 4 if no decoder has joined by then.
        """
        if not self._decoders.wait(max(0.0, self._begun_s + timeout_s - monotonic())):
            raise UserError(f"no decoder came within {timeout_s:g} s", LINK_FAILED)

    def send(self, packet: bytes) -> None:
        """Publish one packet; model and layer packets are cached for decoders that join later."""
        self._models.on_sent(packet)
        try:
            self._reachability = self._current_reachability()
            self._publishers[packet_kind(packet)].put(packet)
        except zenoh.ZError as error:
            raise UserError(f"the link has failed: {_reason(error)}", LINK_FAILED) from error

    def _current_reachability(self) -> Reachability:
        if self._decoders.poll():
            return Reachability.HAS_PEER
        linked = self._listens or self._session.info.transports()
        return Reachability.NO_PEER if linked else Reachability.NO_LINK

    def _name_is_taken(self, key: str) -> bool:
        """Whether the token `key` is declared; one whose owner has left expires with a delay."""
        deadline = monotonic() + LEAVE_GRACE_S
        while any(r.ok for r in self._session.liveliness().get(key, timeout=LEAVE_GRACE_S)):
            if monotonic() >= deadline:
                return True
            sleep(POLL_S)
        return False

    def _publisher(self, key: str, lossless: bool, kind: PacketKind) -> zenoh.Publisher:
        reliable = lossless or kind is not PacketKind.FRAME
        return self._session.declare_publisher(
            key,
            reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
            congestion_control=CongestionControl.BLOCK if reliable else CongestionControl.DROP,
            # Express packets skip batching, which gains nothing at thirty packets a second, but
            # the flag takes two bytes a packet, and an idle link sends at once without it.
            express=reliable,
        )

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            for packet in self._models.packets:
                query.reply(query.key_expr, packet)

    def _decoder_changed(self, sample: zenoh.Sample) -> None:
        change = (
            self._decoders.on_join if sample.kind == SampleKind.PUT else self._decoders.on_leave
        )
        change(str(sample.key_expr))


class ZenohSource(_Session):
    """The decoder's end of a call: a `PacketSource`.

    Returns the model before any frame, whenever it joins.  Ends with the END packet, or without one
    when the encoder has left and no packet has arrived for `leave_grace_s`, since a slow link may
    still deliver packets.
    say: called with a line when it waits for an encoder.
    Raises `UserError` with exit code 4 if the link cannot be made.
    """

    def __init__(
        self,
        options: LinkOptions,
        say: MessageCallback = ignore_message,
        leave_grace_s: float = LEAVE_GRACE_S,
    ) -> None:
        self._grace_s = leave_grace_s
        self._queue = ReceiveQueue()
        self._left_s: float | None = None
        self._last_arrival_s = monotonic()  # when something arrived
        self._complete = self._ended = False
        self._key = f"risorius/{options.call}"
        super().__init__(options, f"an encoder of call {options.call!r}", say)

    def _declare(self, options: LinkOptions) -> None:
        # With a thread for each key, packets would be reordered.
        arrived = Callback(self._arrived, indirect=False)
        for kind in PacketKind:
            self._session.declare_subscriber(f"{self._key}/{kind.name.lower()}", arrived)
        liveliness = self._session.liveliness()
        liveliness.declare_subscriber(
            f"{self._key}/encoder", Callback(self._encoder_changed, indirect=False), history=True
        )
        # After the subscribers, which the token announces.
        self._token = liveliness.declare_token(f"{self._key}/decoder/{self._session.zid()}")

    @property
    def complete(self) -> bool:
        """Whether the END packet has been returned."""
        return self._complete

    @property
    def ended(self) -> bool:
        """Whether no further packet will be returned."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        """The next packet, waiting at most `timeout_s`; None on timeout, or if `ended`."""
        deadline = None if timeout_s is None else monotonic() + timeout_s
        while not self._ended:
            packet = self._queue.take(self._wait_s(deadline))
            if packet is not None:
                self._complete = self._ended = is_end(packet)
                return Arrival(packet, monotonic())
            now, end = monotonic(), self._end_s
            self._ended = end is not None and now >= end
            if deadline is not None and now >= deadline:
                break
        return None

    def __iter__(self) -> Iterator[bytes]:
        while (arrival := self.receive()) is not None:
            yield arrival.data

    def _wait_s(self, deadline: float | None) -> float:
        ends = [end - monotonic() for end in (deadline, self._end_s) if end is not None]
        return max(0.0, min([POLL_S, *ends]))

    @property
    def _end_s(self) -> float | None:
        """Time at which the call ends after its encoder has left; None while it is present."""
        gone_s = self._left_s
        return None if gone_s is None else max(gone_s, self._last_arrival_s) + self._grace_s

    def _arrived(self, sample: zenoh.Sample) -> None:
        self._last_arrival_s = monotonic()
        self._queue.put(sample.payload.to_bytes())

    def _encoder_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == SampleKind.PUT:
            self._left_s = None
            # The model may have been published before; of a repeated one, one is dropped.
            self._session.get(
                f"{self._key}/model",
                Callback(self._replied, indirect=False),
                consolidation=ConsolidationMode.NONE,
            )
        else:
            self._left_s = monotonic()
            self._queue.wake()

    def _replied(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._queue.put(reply.ok.payload.to_bytes())


class ZenohRouter(_Session):
    """Forwards calls between the ends that connect to it, until it is closed.

    Raises `UserError` with exit code 4 if it cannot listen.
    """

    def __init__(self, listen: tuple[str, ...]) -> None:
        super().__init__(LinkOptions("any", listen, router=True))


def _open(options: LinkOptions) -> zenoh.Session:
    """A session, opened in a thread of its own so that Ctrl-C takes effect while it opens."""
    results: list[zenoh.Session | zenoh.ZError] = []
    done: SimpleQueue[None] = SimpleQueue()

    def run() -> None:
        try:
            results.append(zenoh.open(_config(options)))
        except zenoh.ZError as error:
            results.append(error)
        done.put(None)

    # `threading.Thread.start` may swallow an interrupt.
    _thread.start_new_thread(run, ())
    try:
        while not results:
            with suppress(Empty):
                done.get(timeout=POLL_S)
    except BaseException:
        # Python aborts if a thread returns from Zenoh during shutdown.
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
        # Routers forward between clients, but not between peers without gossip.
        "mode": "router" if options.router else "peer" if options.listen else "client",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": options.listen_locators,
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": options.connect_locators,
        "connect/timeout_ms": round(1000 * options.connect_timeout_s),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 1000,
            "period_increase_factor": 1.5,
        },
        # Sequence numbers of one byte instead of up to five.
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
    """Zenoh's message without the source location."""
    return re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))
