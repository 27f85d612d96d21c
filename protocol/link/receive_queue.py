"""A bounded queue of received packets that delivers the model first."""

import threading
from collections import deque
from queue import Empty, SimpleQueue

from protocol.limits import MAX_MODEL_VERSIONS, SEQUENCE_MODULUS
from protocol.packets import PacketKind

MAX_QUEUED_BYTES = 16 * 1024 * 1024
# Memory of an object in a queue in addition to its bytes.
QUEUE_OVERHEAD_BYTES = 64
# Frame packets that wait for the model, which a late joiner gets after one round trip.
MAX_WAITING_FRAMES = 256


class ReceiveQueue:
    """A queue between the receiving thread and the decoding one.

    Frame packets received before any model packet wait for one; beyond `MAX_WAITING_FRAMES` the
    oldest are dropped.  A repeated model packet is dropped, and so is a packet that would make the
    queue larger than `limit_bytes`.
    """

    def __init__(self, limit_bytes: int = MAX_QUEUED_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._lock = threading.Lock()
        self._queue: SimpleQueue[bytes | None] = SimpleQueue()
        self._queued_bytes = 0
        self._waiting_for_model: deque[bytes] = deque(maxlen=MAX_WAITING_FRAMES)
        self._models: deque[bytes] = deque(maxlen=MAX_MODEL_VERSIONS)

    def put(self, packet: bytes) -> None:
        """Add a packet, from any thread."""
        with self._lock:
            kind = packet[0] // SEQUENCE_MODULUS if packet else None
            if kind == PacketKind.MODEL:
                self._put_model(packet)
            elif self._models or kind == PacketKind.LAYER:
                self._enqueue(packet)
            else:
                self._waiting_for_model.append(packet)

    def take(self, timeout_s: float | None) -> bytes | None:
        """The oldest packet; None after `timeout_s`, or on `wake`."""
        try:
            packet = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        if packet is not None:
            with self._lock:
                self._queued_bytes -= len(packet) + QUEUE_OVERHEAD_BYTES
        return packet

    def wake(self) -> None:
        """Make a waiting `take` return None."""
        self._queue.put(None)

    def _put_model(self, packet: bytes) -> None:
        if packet not in self._models:
            self._models.append(packet)
            self._enqueue(packet)
            while self._waiting_for_model:
                self._enqueue(self._waiting_for_model.popleft())

    def _enqueue(self, packet: bytes) -> None:
        cost = len(packet) + QUEUE_OVERHEAD_BYTES
        if self._queued_bytes + cost <= self._limit_bytes:
            self._queued_bytes += cost
            self._queue.put(packet)
