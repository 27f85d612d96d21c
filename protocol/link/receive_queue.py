"""Packets that have come from a network and not been taken: bounded, the model first."""

import threading
from collections import deque
from queue import Empty, SimpleQueue

from protocol.limits import MAX_MODEL_VERSIONS, SEQUENCE_MODULUS
from protocol.packets import PacketKind

MAX_QUEUED_BYTES = 16 * 1024 * 1024
# What an object in a queue weighs besides its bytes.
QUEUE_OVERHEAD_BYTES = 64
# Frames held back until a late joiner has the model, which takes one round trip.
MAX_WAITING_FRAMES = 256


class ReceiveQueue:
    """A queue between the thread that receives and the one that decodes.

    Frames that come before any model packet are held until one does, the oldest dropped beyond
    `MAX_HELD_FRAMES`.  Dropped are a model packet that is the same as an earlier one, and what
    would make the queue larger than `limit_bytes`.
    """

    def __init__(self, limit_bytes: int = MAX_QUEUED_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._lock = threading.Lock()
        self._queue: SimpleQueue[bytes | None] = SimpleQueue()
        self._queued_bytes = 0
        self._waiting_for_model: deque[bytes] = deque(maxlen=MAX_WAITING_FRAMES)
        self._models: deque[bytes] = deque(maxlen=MAX_MODEL_VERSIONS)

    def put(self, packet: bytes) -> None:
        """Take in a packet from any thread."""
        with self._lock:
            kind = packet[0] // SEQUENCE_MODULUS if packet else None
            if kind == PacketKind.MODEL:
                self._put_model(packet)
            elif self._models or kind == PacketKind.LAYER:
                self._enqueue(packet)
            else:
                self._waiting_for_model.append(packet)

    def take(self, timeout_s: float | None) -> bytes | None:
        """The oldest packet; None if none came within `timeout_s`, or on `wake`."""
        try:
            packet = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        if packet is not None:
            with self._lock:
                self._queued_bytes -= len(packet) + QUEUE_OVERHEAD_BYTES
        return packet

    def wake(self) -> None:
        """Have whoever waits in `take` look around."""
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
