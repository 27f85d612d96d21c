"""The decoder's end of a call over a network."""

from time import monotonic

from protocol.link.delivery.arrival_queue import ArrivalQueue
from protocol.link.delivery.peers import EncoderMonitor
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.interface import (
    POLL_S,
    Arrival,
    LinkOptions,
    MessageCallback,
    PacketProtection,
    PacketSource,
)
from protocol.link.link_end import CarrierFactory, LinkEnd, link_service
from protocol.link.messages import Role
from protocol.packets import is_end

# Time that a call without END waits for more once its encoder has said that it leaves.
LEAVE_GRACE_S = 1.0


class LinkSource(LinkEnd, PacketSource):
    """The decoder's end of a call: a `PacketSource`.

    Returns the model before any frame, whenever it joins.  Ends with the END packet; without one
    once the encoder has said that it leaves and nothing has come for `LEAVE_GRACE_S`, or has been
    silent for two minutes.  An encoder that is started again goes on with the call.
    say: called with a line when it waits for an encoder, and for one that has become silent.
    Raises `UserError` with exit code 4 if the link cannot be made.
    """

    def __init__(
        self,
        options: LinkOptions,
        protection: PacketProtection,
        make_carrier: CarrierFactory,
        say: MessageCallback,
    ) -> None:
        self._complete = self._ended = False
        self._encoder = EncoderMonitor(say, LEAVE_GRACE_S)
        self._delivery = DeliveryReceiver(protection.session, protection.on_peer)
        self._queue = ArrivalQueue(self._delivery)
        service = link_service(options, self._delivery, protection, self._queue.put)
        super().__init__(
            options, service, make_carrier, say, f"an encoder of call {options.call!r}"
        )

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
        deadline_s = None if timeout_s is None else monotonic() + timeout_s
        while not self._ended:
            wait_s = POLL_S if deadline_s is None else min(POLL_S, deadline_s - monotonic())
            if (arrival := self._queue.take(wait_s)) is not None:
                self._complete = self._ended = is_end(arrival.data)
                return arrival
            self._service.raise_failure()
            self._ended = self._is_over(monotonic())
            if deadline_s is not None and monotonic() >= deadline_s:
                break
        return None

    def _farewell(self) -> bytes | None:
        with self._service.lock:
            return self._delivery.bye()

    def _is_over(self, now_s: float) -> bool:
        """Whether a call without END is at its end; says when the encoder is silent."""
        with self._service.lock:
            heard_s, has_left = self._delivery.heard_s, self._delivery.has_left
        if heard_s is None:
            self._tell_of_others(Role.ENCODER)
            return False
        return self._encoder.is_over(now_s - heard_s, has_left)
