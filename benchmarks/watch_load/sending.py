"""The encoder's end of a measurement."""

import time
from pathlib import Path
from typing import Self

import zenoh

from benchmarks.relay_load.ends import PACKETS_PER_S
from protocol.call_file import CallReader
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkOptions
from protocol.link.presence import call_keys, page_key
from protocol.link.zenoh_session import zenoh_config
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, parse_packet, serialise
from protocol.security.link_security import LinkSecurity

WAIT_S = 60.0
# After so long the last packet has come.
ON_THEIR_WAY_S = 1.0


class Sending:
    """Sends the frame packets of a call file again and again, its model first; a context manager.

    bytes_back: what has come back to it at the relay.
    """

    def __init__(self, file: Path, call: str, place: str) -> None:
        with CallReader(file) as reader:
            packets = [parse_packet(data) for data in reader]
        self._frames = [each for each in packets if isinstance(each, FramePacket)]
        self._model = next(each for each in packets if isinstance(each, ModelPacket))
        self._number = 0
        self.bytes_back = 0
        options = LinkOptions(
            call, connect=(place,), connect_timeout_s=WAIT_S, security=LinkSecurity(None)
        )
        self._sink = open_link_sink(options)
        self._listening = zenoh.open(zenoh_config({"mode": "client", "connect/endpoints": [place]}))
        _, heard_key = call_keys(call, is_encoder=True)
        self._listening.declare_subscriber(page_key(heard_key, "**"), self._count)

    def send(self, seconds: float) -> dict[int, float]:
        """Send at their pace; when each was sent, by its number."""
        sent: dict[int, float] = {}
        begun_s = time.monotonic()
        for index in range(int(seconds * PACKETS_PER_S)):
            due_s = begun_s + (index + 1) / PACKETS_PER_S
            time.sleep(max(0.0, due_s - time.monotonic()))
            packet = self._frames[self._number % len(self._frames)]
            sent[self._number] = time.monotonic()
            self._sink.send(serialise(FramePacket(self._number % SEQUENCE_MODULUS, packet.payload)))
            self._number += 1
        time.sleep(ON_THEIR_WAY_S)
        return sent

    def _count(self, sample: zenoh.Sample) -> None:
        self.bytes_back += len(sample.payload)

    def __enter__(self) -> Self:
        try:
            self._sink.send(serialise(self._model))
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """End the call."""
        self._listening.close()  # type: ignore[no-untyped-call]
        self._sink.close()
