"""What the encoder's report will say, as it grows."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from protocol.link.interface import PacketSink
from protocol.packets import Packet, serialise


@dataclass(slots=True)
class Tally:
    """Counts, times and warnings of one call on the sending side.

    frames: of the call, where these may be fewer than were captured; None: as many.
    """

    frames: int | None = None
    model_bytes: int = 0
    frame_bytes: int = 0
    packets: int = 0
    lost_frames: int = 0
    warnings: list[str] = field(default_factory=list)
    capture_ns: list[int] = field(default_factory=list)
    spent_ns: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time in the `with` block for stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            self.spent_ns[name] = self.spent_ns.get(name, 0) + time.perf_counter_ns() - start

    def warn(self, message: str) -> None:
        """Note a line for the user, once."""
        if message not in self.warnings:
            self.warnings.append(message)

    def send(self, sink: PacketSink, packet: Packet) -> None:
        """Pass a packet on, timed and counted."""
        with self.stage("send"):
            sink.send(serialise(packet))
        self.packets += 1
