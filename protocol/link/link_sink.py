"""The encoder's end of a call over a network."""

from time import monotonic, sleep

from protocol.link.delivery.peers import PeerMonitor
from protocol.link.delivery.sender import DeliverySender
from protocol.link.interface import (
    POLL_S,
    LinkOptions,
    LinkQuality,
    MessageCallback,
    PacketProtection,
    Reachability,
)
from protocol.link.link_end import CarrierFactory, LinkEnd, link_service
from protocol.link.messages import Role
from protocol.packets import is_end
from shared_model.errors import LINK_FAILED, UserError

# How long a decoder that is present is waited for until it has measured the link.
MEASURE_S = 4.0
# How long the other encoder of a call is given to be gone.
BUSY_PATIENCE_S = 4.0


class LinkSink(LinkEnd):
    """The encoder's end of a call: a `PacketSink`.

    say: called with a line when it waits for a decoder, when the last decoder has left, and when
        one has joined again.
    Raises `UserError` with exit code 4 if the link cannot be made.
    """

    def __init__(
        self,
        options: LinkOptions,
        protection: PacketProtection,
        make_carrier: CarrierFactory,
        say: MessageCallback,
    ) -> None:
        self._delivery = DeliverySender(
            protection.session, options.lossless, protection.on_peer, options.rate_bps
        )
        self._decoders = PeerMonitor(say)
        self._reachability, self._ended_s = Reachability.NO_PEER, None
        service = link_service(options, self._delivery, protection)
        super().__init__(options, service, make_carrier, say, f"a decoder of call {options.call!r}")

    _ended_s: float | None

    @property
    def peers(self) -> int:
        """Number of decoders present."""
        self._update_peers()
        return len(self._decoders)

    @property
    def reachability(self) -> Reachability:
        """Reachability of the newest packet; an encoder that listens always has a link.

        After `close` that of the end of the call.
        """
        is_unheard = self._reachability is Reachability.NO_PEER and not self._closed
        return Reachability.BUSY if is_unheard and self._is_busy else self._reachability

    @property
    def _is_busy(self) -> bool:
        with self._service.lock:
            return self._delivery.is_busy(monotonic())

    @property
    def quality(self) -> LinkQuality:
        """Of the worst link to a decoder."""
        with self._service.lock:
            return self._delivery.quality

    def wait_for_peer(self, timeout_s: float) -> None:
        """Wait for a decoder, which then receives all packets sent from now on.

        timeout_s: from the construction of the sink.
        Raises `UserError` with exit code 4 if no decoder has joined by then, or if those that are
        there listen to another encoder.
        """
        busy_since_s: float | None = None
        while not self.peers:
            self._service.raise_failure()
            now_s = monotonic()
            self._tell_of_others(Role.DECODER)
            if not self._is_busy:
                busy_since_s = None
            elif busy_since_s is None:
                busy_since_s = now_s
            elif now_s - busy_since_s > BUSY_PATIENCE_S:
                raise self._name_is_taken()
            if now_s - self._begun_s >= timeout_s:
                others = self._others(Role.DECODER)
                why = f"; {others}" if others else ""
                raise UserError(f"no decoder came within {timeout_s:g} s{why}", LINK_FAILED)
            sleep(POLL_S / 5)
        measured_s = monotonic() + MEASURE_S
        while not self._is_measured and monotonic() < measured_s:
            sleep(POLL_S / 5)

    @property
    def _is_measured(self) -> bool:
        with self._service.lock:
            return self._delivery.is_measured

    def send(self, packet: bytes) -> None:
        """Send one packet.  Raises `UserError` if the sink is closed."""
        if self._closed:
            raise UserError("the link has failed: it is closed", LINK_FAILED)
        self._service.raise_failure()
        with self._service.lock:
            self._delivery.send(packet)
            self._update_peers()
            self._reachability = self._current_reachability()
            self._service.flush()
        if is_end(packet):
            self._ended_s = monotonic()

    def _finish(self) -> None:
        """A call that has ended is repeated until each decoder has all of it, while any is heard
        and more of it gets there.
        """
        if self._ended_s is None:
            return
        while self._is_awaited(self._ended_s):
            sleep(POLL_S / 10)
        if self._delivery.is_end_heard:
            self._reachability = Reachability.HAS_PEER

    def _farewell(self) -> bytes | None:
        return self._delivery.bye() if self.peers else None

    def _is_awaited(self, ended_s: float) -> bool:
        """Whether a decoder may still take the end of the call."""
        with self._service.lock:
            return self._delivery.is_awaited(ended_s, monotonic())

    def _update_peers(self) -> None:
        with self._service.lock:
            self._decoders.update(len(self._delivery.peers))

    def _current_reachability(self) -> Reachability:
        if self._decoders.poll():
            return Reachability.HAS_PEER
        return Reachability.NO_PEER if self._service.is_linked else Reachability.NO_LINK

    def _name_is_taken(self) -> UserError:
        return UserError(
            f"call {self._options.call!r} has an encoder already; choose another name with --call",
            LINK_FAILED,
        )
