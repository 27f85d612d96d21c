"""Counts the packets of one direction of a call, copies them, and stamps when they were read."""

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Lock, Thread

from encoder.packet_sink import ForwardingSink
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival, PacketSink, PacketSource
from risorius.live_call.messages import Traffic


class TrafficMeter:
    """Adds up packets; any thread may ask."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, Lock()
        self._bytes = self._packets = 0
        self._since_s = clock()
        self.last_s: float | None = None  # when the newest packet came

    def add(self, size: int) -> None:
        """Count a packet of so many bytes."""
        with self._lock:
            self._bytes, self._packets = self._bytes + size, self._packets + 1
            self.last_s = self._clock()

    def take(self) -> Traffic:
        """What has been counted since the last time."""
        with self._lock:
            now_s = self._clock()
            traffic = Traffic(self._bytes, self._packets, now_s - self._since_s)
            self._bytes, self._packets, self._since_s = 0, 0, now_s
        return traffic


class MeteredSink(ForwardingSink):
    """A `PacketSink` that counts what it sends to another one.

    on_packet: called with each packet.
    """

    def __init__(
        self, sink: PacketSink, meter: TrafficMeter, on_packet: Callable[[bytes], None]
    ) -> None:
        super().__init__(sink)
        self._meter, self._on_packet = meter, on_packet

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        self._meter.add(len(packet))
        super().send(packet)
        self._on_packet(packet)


class MeteredSource(PacketSource):
    """A `PacketSource` that counts what comes out of another one.

    on_arrival: called with each packet.
    """

    def __init__(
        self, source: PacketSource, meter: TrafficMeter, on_arrival: Callable[[Arrival], None]
    ) -> None:
        self._source, self._meter, self._on_arrival = source, meter, on_arrival

    @property
    def complete(self) -> bool:
        """That of the other source."""
        return self._source.complete

    @property
    def ended(self) -> bool:
        """That of the other source."""
        return self._source.ended

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        """See `PacketSource`."""
        arrival = self._source.receive(timeout_s)
        if arrival is not None:
            self._meter.add(len(arrival.data))
            self._on_arrival(arrival)
        return arrival

    def close(self) -> None:
        """Close the other source."""
        self._source.close()


class StampedSource(PacketSource):
    """A `PacketSource` that reads another one in a thread of its own, until that ends."""

    def __init__(self, source: PacketSource) -> None:
        self._source = source
        self._queue: SimpleQueue[Arrival | None] = SimpleQueue()
        self._ended = False
        Thread(target=self._read, daemon=True).start()

    @property
    def complete(self) -> bool:
        """That of the other source, once all is taken."""
        return self._ended and self._source.complete

    @property
    def ended(self) -> bool:
        """Whether no further packet will be returned."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        """See `PacketSource`."""
        if self._ended:
            return None
        try:
            arrival = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        self._ended = arrival is None
        return arrival

    def close(self) -> None:
        """Close the other source."""
        self._source.close()

    def _read(self) -> None:
        # A process that was killed has not written its last packet to the end.
        try:
            while (arrival := self._source.receive()) is not None:
                self._queue.put(Arrival(arrival.data, time.monotonic()))
        except (ProtocolError, OSError, ValueError):
            pass
        self._queue.put(None)
