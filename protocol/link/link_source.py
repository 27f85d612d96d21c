"""The decoder's end of a call over a network."""

from time import monotonic

from protocol.link.delivery.arrival_queue import ArrivalQueue
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
# After what silence a decoder says so, and gives a call up that has begun.
SILENT_S, LOST_S = 5.0, 120.0


class LinkSource(LinkEnd, PacketSource):
    """The decoder's end of a call: a `PacketSource`.

    Returns the model before any frame, whenever it joins.  Ends with the END packet; without one
    once the encoder has said that it leaves and nothing has come for `leave_grace_s`, or has been
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
        leave_grace_s: float = LEAVE_GRACE_S,
    ) -> None:
        self._grace_s = leave_grace_s
        self._queue = ArrivalQueue()
        self._complete = self._ended = self._is_silent = False
        self._delivery = DeliveryReceiver(protection.session, protection.on_peer)
        service = link_service(options, self._delivery, protection, self._enqueue)
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

    def close(self) -> None:
        """See `PacketSource`; the encoder is told."""
        with self._service.lock:
            farewell = self._delivery.bye()
        self._leave(farewell)

    def _enqueue(self, arrival: Arrival) -> None:
        """Called in the thread of the service, which holds its lock."""
        self._queue.put(arrival, may_drop_frames=not self._delivery.repeats_frames)

    def _is_over(self, now_s: float) -> bool:
        """Whether a call without END is at its end; says when the encoder is silent."""
        with self._service.lock:
            heard_s, has_left = self._delivery.heard_s, self._delivery.has_left
        if heard_s is None:
            self._tell_of_others(Role.ENCODER)
            return False
        silent_s = now_s - heard_s
        if (silent_s > SILENT_S) != self._is_silent and not has_left:
            self._is_silent = not self._is_silent
            self._say(
                "nothing comes from the encoder; waiting for it"
                if self._is_silent
                else "the encoder is there again"
            )
        return silent_s > (self._grace_s if has_left else LOST_S)
