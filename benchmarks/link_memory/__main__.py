"""Memory of a long call: python -m benchmarks link_memory CALL [--minutes N] [--loss PERCENT]

Sends the packets of a call file over and over, in simulated time, from an encoder's end of a link
to a decoder's over a wire that loses, repeats, reorders and is cut for ten seconds every five
minutes; with an update of the model and a layer each minute.  What arrives is played out.  Prints
the process's memory after each minute, and by how much it has grown since the fifth.
"""

import argparse
import gc
import heapq
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from pathlib import Path

from benchmarks.bad_wire.wire import Faults, Lane
from benchmarks.command import run
from benchmarks.measured_process import memory_bytes
from decoder.playout.receiver import Receiver
from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, parse_packet, serialise

STEP_S, MINUTE_S, SETTLED_MINUTES = 0.02, 60.0, 5
CUT_EVERY_S, CUT_S, LAYER_BYTES = 300.0, 10.0, 900
# An update comes so many packets before the first one that needs it.
LEAD = 6


@dataclass
class LongCall:
    """A call between both ends of a link.

    arrived: frame packets; shown: pictures; damaged: packets that could not be decoded, since their
        order is another one than that in which they were coded.
    """

    model: ModelPacket
    frames: Sequence[FramePacket]
    faults: Faults
    now_s: float = 0.0
    arrived: int = 0
    shown: int = 0
    damaged: int = 0
    _flying: list[tuple[float, int, bool, bytes]] = field(default_factory=list)
    _count: int = 0

    def __post_init__(self) -> None:
        self._lanes = {down: Lane(self.faults, seed) for down, seed in ((True, 1), (False, 2))}
        self._sender = DeliverySender(b"encoder1", False, lambda session: None)
        self._receiver = DeliveryReceiver(b"decoder1", lambda session: None)
        self._playout = Receiver()
        self._run(3)
        self._sender.send(serialise(replace(self.model, sequence=0)))
        self._payloads = cycle(self.frames[1:])
        self._sent, self._versions = 0, 1
        self._send_frame(self.frames[0])

    def minutes(self, count: int) -> Iterator[None]:
        """Go on for so many minutes; one step for each."""
        interval_s = self.model.call.frames_per_packet / self.model.call.fps
        for _ in range(count):
            for _ in range(round(MINUTE_S / interval_s)):
                self._send_frame(next(self._payloads))
                self._run(interval_s)
            self._update()
            yield

    def _send_frame(self, packet: FramePacket) -> None:
        sequence = self._sent % SEQUENCE_MODULUS
        self._sender.send(serialise(replace(packet, sequence=sequence)))
        self._sent += 1

    def _update(self) -> None:
        sequence, version = (self._sent + LEAD) % SEQUENCE_MODULUS, self._versions
        update = replace(
            self.model,
            sequence=sequence,
            version=version,
            version_count=version + 1,
            background=b"",
        )
        self._sender.send(serialise(update))
        self._sender.send(serialise(LayerPacket(version, 0, bytes(LAYER_BYTES))))
        self._versions += 1

    def _run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            while self._flying and self._flying[0][0] <= self.now_s:
                _, _, down, payload = heapq.heappop(self._flying)
                if down:
                    self._play(self._receiver.receive(payload, self.now_s))
                else:
                    self._sender.receive(payload, self.now_s)
            self._put(True, self._sender.payloads(self.now_s))
            self._put(False, self._receiver.payloads(self.now_s))

    def _put(self, down: bool, payloads: Sequence[bytes]) -> None:
        for payload in payloads:
            arrivals = self._lanes[down].carry(len(payload), self.now_s)
            for arrival_s in arrivals if self.now_s % CUT_EVERY_S < CUT_EVERY_S - CUT_S else ():
                self._count += 1
                heapq.heappush(self._flying, (arrival_s, self._count, down, payload))

    def _play(self, arrivals: Sequence[Arrival]) -> None:
        for arrival in arrivals:
            packet = parse_packet(arrival.data)
            self.arrived += isinstance(packet, FramePacket)
            # The frame packets are all coded by the first model.
            is_first = isinstance(packet, ModelPacket) and self._playout.model is None
            if not is_first and not isinstance(packet, FramePacket):
                continue
            try:
                self.shown += len(self._playout.receive(arrival))
                self.shown += len(self._playout.poll(self.now_s))
            except ProtocolError:
                self.damaged += 1


def main(argv: Sequence[str]) -> None:
    """Print the memory of each minute."""
    parser = argparse.ArgumentParser(
        prog="link_memory",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("call", type=Path, metavar="CALL")
    parser.add_argument("--minutes", type=int, default=30, metavar="N")
    parser.add_argument("--loss", type=float, default=10.0, metavar="PERCENT")
    options = parser.parse_args(argv)
    found = list[float]()
    call = long_call(options.call, options.loss / 100)
    for _ in call.minutes(options.minutes):
        gc.collect()
        found.append(memory_mb())
        print(f"minute {len(found)}: {found[-1]:.1f} MB", flush=True)
    print(f"{call.arrived} frame packets, {call.shown} pictures, {call.damaged} damaged packets")
    if len(found) > SETTLED_MINUTES:
        settled = found[SETTLED_MINUTES - 1 :]
        change = 100 * (max(settled) / settled[0] - 1)
        print(f"most since minute {SETTLED_MINUTES}: {change:+.1f} %")


def long_call(path: Path, loss: float) -> LongCall:
    """A call of the packets of a call file over a bad wire.  loss: share, 0..1."""
    with CallReader(path) as reader:
        packets = [parse_packet(data) for data in reader]
    (model, *_) = [packet for packet in packets if isinstance(packet, ModelPacket)]
    frames = [packet for packet in packets if isinstance(packet, FramePacket)]
    faults = Faults(loss=loss, delay_ms=50, jitter_ms=20, duplicates=0.02)
    return LongCall(model, frames, faults)


def memory_mb() -> float:
    """Resident memory of this process now (Linux), MB."""
    return memory_bytes(os.getpid()) / 2**20


if __name__ == "__main__":
    run(main)
