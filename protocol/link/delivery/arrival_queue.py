"""What has come over a link and waits to be taken, in bounded memory."""

from queue import Empty, SimpleQueue
from threading import Lock
from typing import Protocol

from protocol.link.interface import Arrival
from protocol.packets import PacketKind, packet_kind
from shared_model.errors import LINK_FAILED, UserError

# Memory of an arrival besides its bytes.
ARRIVAL_OVERHEAD_BYTES = 128
# Frame packets that prediction heals without are left out while more than the first waits; all else
# has been acknowledged, and ends the link beyond the second.
MAX_FRAME_BYTES, MAX_BYTES = 16 * 1024 * 1024, 32 * 1024 * 1024


class Delivery(Protocol):
    """repeats_frames: frame packets are sent until they are there."""

    repeats_frames: bool


class ArrivalQueue:
    """Arrivals of a delivery in order, put in one thread and taken in another."""

    def __init__(self, delivery: Delivery) -> None:
        self._delivery = delivery
        self._queue: SimpleQueue[Arrival] = SimpleQueue()
        self._waiting_bytes, self._counting = 0, Lock()

    def put(self, arrival: Arrival) -> None:
        """Add an arrival, or leave out a frame packet that may be missing.

        Raises `UserError` with exit code 4 if too much waits to leave it out.
        """
        cost = _cost(arrival)
        is_frame = packet_kind(arrival.data) is PacketKind.FRAME
        is_spare = is_frame and not self._delivery.repeats_frames
        with self._counting:
            waiting_bytes = self._waiting_bytes + cost
            if is_spare and waiting_bytes > MAX_FRAME_BYTES:
                return
            if waiting_bytes > MAX_BYTES:
                raise UserError(
                    f"{MAX_BYTES >> 20} MB of the call wait to be drawn: this end is too slow",
                    LINK_FAILED,
                )
            self._waiting_bytes = waiting_bytes
        self._queue.put(arrival)

    def take(self, timeout_s: float) -> Arrival | None:
        """The next arrival, waiting at most `timeout_s`; None: there is none by then."""
        try:
            arrival = self._queue.get(timeout=max(0.0, timeout_s))
        except Empty:
            return None
        with self._counting:
            self._waiting_bytes -= _cost(arrival)
        return arrival


def _cost(arrival: Arrival) -> int:
    return len(arrival.data) + ARRIVAL_OVERHEAD_BYTES
