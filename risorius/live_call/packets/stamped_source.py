"""Packets of a pipe with the time at which each has come, however late it is taken."""

import time
from queue import Empty, SimpleQueue
from threading import Thread

from protocol.errors import ProtocolError
from protocol.link.interface import Arrival, PacketSource


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
