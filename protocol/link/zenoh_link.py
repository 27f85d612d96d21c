"""A call over Zenoh: the only file that imports it.

Keys: risorius/CALL/model (published, and queryable with the layers for who joins late),
risorius/CALL/layer, risorius/CALL/frame and risorius/CALL/control.  Each end keeps a liveliness
token, so that the other knows when it comes and goes.  Nothing is found by multicast: one end
listens where the other connects, or both connect to a router.
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
from protocol.link.interface import LinkOptions, MessageCallback, Reachability, ignore_message
from protocol.link.model_cache import ModelCache
from protocol.link.peers import POLL_S, PeerMonitor
from protocol.link.receive_queue import ReceiveQueue
from protocol.packets import PacketKind, is_end, packet_kind
from shared_model.errors import LINK_FAILED, UserError

# Bytes that a live frame packet grows by, measured with 8-bit sequence numbers and declared keys:
# under UDP, under TCP; then what IP adds (20 and 8 of UDP, 20 and 32 of TCP with timestamps).
ZENOH_OVERHEAD_BYTES = {"udp": 6, "tcp": 8}
IP_OVERHEAD_BYTES = {"udp": 28, "tcp": 52}
# For how long a call without END waits for its encoder to come back.
LEAVE_GRACE_S = 1.0
# How long a session that nobody wants any more may take to open.
OPENING_S = 0.5


class _Session:
    """An open session, closed on leaving the `with` block.

    Callbacks run in the thread that receives: one of its own for each, which ends with its session
    only, would keep an interrupted program from ending.
    """

    def __init__(
        self, options: LinkOptions, waiting_for: str = "", say: MessageCallback = ignore_message
    ) -> None:
        """awaited: whom to name when it is said where the session connects to or listens."""
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
    """The encoder's end of a call: a `PacketSink`.  Zenoh connects it again by itself.

    say: takes a line that says where a decoder is waited for; later when nobody listens any more,
        or somebody does again.
    Raises `UserError` with exit code 4 if the link cannot be made, or has an encoder of the same
    call already; two that start at the same moment may miss each other.
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
        """Number of decoders that are there."""
        return len(self._decoders)

    @property
    def reachability(self) -> Reachability:
        """Whom the newest packet could reach; an encoder that listens always has its link."""
        return self._reachability

    def wait_for_peer(self, timeout_s: float) -> None:
        """Return once a decoder is there and will get all that is sent from now on.

        Raises `UserError` with exit code 4 if none has come within `timeout_s` from when the link
        began to be made.
        """
        if not self._decoders.wait(max(0.0, self._begun_s + timeout_s - monotonic())):
            raise UserError(f"no decoder came within {timeout_s:g} s", LINK_FAILED)

    def send(self, packet: bytes) -> None:
        """Publish one packet; models in use and their layers are kept for who joins later."""
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
        """Whether somebody keeps the token `key`; one who leaves may take a moment to be gone."""
        deadline = monotonic() + LEAVE_GRACE_S
        while any(r.ok for r in self._session.liveliness().get(key, timeout=LEAVE_GRACE_S)):
            if monotonic() >= deadline:
                return True
            sleep(POLL_S)
        return False

    def _publisher(self, key: str, lossless: bool, kind: PacketKind) -> zenoh.Publisher:
        sure = lossless or kind is not PacketKind.FRAME
        return self._session.declare_publisher(
            key,
            reliability=Reliability.RELIABLE if sure else Reliability.BEST_EFFORT,
            congestion_control=CongestionControl.BLOCK if sure else CongestionControl.DROP,
            # Holding packets back for a batch gains nothing at thirty a second, but saying so costs
            # two bytes each, and an idle link sends a live frame at once anyway.
            express=sure,
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

    Hands out the model before any frame, whenever it joins.  Ends with the END packet, or when the
    encoder has been gone for `gone_grace_s` without one, and nothing has come for as long: a slow
    link goes on delivering.
    say: takes a line that says where an encoder is waited for.
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
        # With a thread for each key, packets would change places.
        arrived = Callback(self._arrived, indirect=False)
        for kind in PacketKind:
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
            packet = self._queue.take(self._wait_s(deadline))
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

    def _wait_s(self, deadline: float | None) -> float:
        ends = [end - monotonic() for end in (deadline, self._end_s) if end is not None]
        return max(0.0, min([POLL_S, *ends]))

    @property
    def _end_s(self) -> float | None:
        """When to wait no longer for an encoder that is gone."""
        gone_s = self._left_s
        return None if gone_s is None else max(gone_s, self._last_arrival_s) + self._grace_s

    def _arrived(self, sample: zenoh.Sample) -> None:
        self._last_arrival_s = monotonic()
        self._queue.put(sample.payload.to_bytes())

    def _encoder_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == SampleKind.PUT:
            self._left_s = None
            # The model may have been published before we came; if also after, one is dropped.
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
        while not results:
            with suppress(Empty):
                done.get(timeout=POLL_S)
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
