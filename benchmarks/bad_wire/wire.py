"""Hosts joined by one bad wire, on one machine: network namespaces whose packets pass through us.

Every IP packet from one host to another can be lost, delayed, put out of order, sent twice, held up
by a rate, and is counted.  The same seed and the same packets in the same order have the same fate.
"""

import heapq
import os
import random
import select
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import IO, Self

from benchmarks.bad_wire.network_namespace import NetworkNamespace

_IP_VERSION, _DESTINATION = 4, slice(16, 20)
_READ_BYTES = 65536
# How often the wire looks whether it shall end.
_TICK_S = 0.05
# How long a host's process may take to end before it is killed.
END_PATIENCE_S = 5.0


@dataclass(frozen=True, slots=True)
class Faults:
    """What a wire does to the packets in each direction.

    loss: share of the packets that are lost, 0..1.
    burst: mean number of packets that are lost in a row; 1: each by itself.
    delay_ms: one way; jitter_ms: added to it or taken off, evenly up to so much, so that packets
        overtake one another.
    duplicates: share of the packets that come twice, 0..1.
    rate_bps: bits a second, IP headers included; 0: any number.
    queue_bytes: what waits for its turn beyond so much is lost; 0: nothing.
    cuts: times (from, to), seconds since the wire began to carry, when nothing passes.
    """

    loss: float = 0.0
    burst: float = 1.0
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    duplicates: float = 0.0
    rate_bps: float = 0.0
    queue_bytes: int = 0
    cuts: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("loss", "duplicates"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise ValueError(f"{name} is {share}, expected a share of at least 0 and below 1")
        for name in ("delay_ms", "jitter_ms", "rate_bps", "queue_bytes"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 or more")
        if self.burst < 1:
            raise ValueError(f"burst is {self.burst}, expected 1 or more packets")
        for start, end in self.cuts:
            if end < start:
                raise ValueError(f"cut from {start} to {end} s, expected an end after its start")


class Lane:
    """One direction of a wire: says when each packet arrives.  Does no input or output."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults, self._random = faults, random.Random(seed)
        self._losing = False
        self._free_s = 0.0  # when the packets before have been sent

    def carry(self, size: int, now_s: float, since_s: float = 0.0) -> tuple[float, ...]:
        """When a packet of `size` bytes sent at `now_s` arrives: never, once or twice.

        now_s: seconds, never less than before.  since_s: the time from which cuts are counted.
        """
        faults = self._faults
        # All chances are drawn for each packet: its fate does not hang on that of others.
        lost, twice = self._is_lost(), self._random.random() < faults.duplicates
        late = [self._random.uniform(-faults.jitter_ms, faults.jitter_ms) for _ in range(2)]
        if lost or any(start <= now_s - since_s < end for start, end in faults.cuts):
            return ()
        sent_s = now_s
        if faults.rate_bps:
            begin_s = max(now_s, self._free_s)
            waiting = (begin_s - now_s) * faults.rate_bps / 8
            if faults.queue_bytes and waiting + size > faults.queue_bytes:
                return ()
            sent_s = self._free_s = begin_s + 8 * size / faults.rate_bps
        return tuple(
            max(now_s, sent_s + (faults.delay_ms + each_ms) / 1000) for each_ms in late[: 1 + twice]
        )

    def _is_lost(self) -> bool:
        """Losses come in runs of geometric length, Gilbert's model."""
        loss, burst = self._faults.loss, self._faults.burst
        if burst == 1:
            return self._random.random() < loss
        leave, enter = 1 / burst, loss / (1 - loss) / burst
        self._losing = self._random.random() < (1 - leave if self._losing else enter)
        return self._losing


@dataclass(slots=True)
class Traffic:
    """What a host has sent: packets and bytes of IP, those lost, and the bytes of each second."""

    packets: int = 0
    bytes: int = 0
    lost: int = 0
    bytes_by_second: Counter[int] = field(default_factory=Counter)

    def count(self, size: int, now_s: float) -> None:
        """A packet of `size` bytes has been sent."""
        self.packets += 1
        self.bytes += size
        self.bytes_by_second[int(now_s)] += size


class Host:
    """One end of a wire: a namespace with an address, and the processes that run in it.

    traffic: what it has sent.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.traffic = Traffic()
        self._namespace = NetworkNamespace(address)
        self._processes: list[subprocess.Popen[bytes]] = []

    @property
    def tun(self) -> int:
        """The descriptor its packets are read from and written to."""
        return self._namespace.tun

    def run(
        self, command: Sequence[str], output: IO[bytes], environment: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a command on this host, see `NetworkNamespace.run`; ended with the wire at last."""
        process = self._namespace.run(command, output, environment)
        self._processes.append(process)
        return process

    def readdress(self, address: str) -> None:
        """Take another address."""
        self._namespace.readdress(address)
        self.address = address

    def close(self) -> None:
        """End what still runs and give the namespace up."""
        for process in self._processes:
            end(process)
        self._namespace.close()


class BadWire:
    """Hosts of the given addresses (all of one /24) and the wire between them, which carries until
    the `with` block is left.

    Raises `OSError` where `network_namespace.obstacle` names one.
    """

    def __init__(self, addresses: Sequence[str], faults: Faults, seed: int = 1) -> None:
        self.hosts: tuple[Host, ...] = ()
        try:
            for address in addresses:
                self.hosts += (Host(address),)
        except OSError:
            self._close_hosts()
            raise
        self._lanes = {host.tun: Lane(faults, seed + i) for i, host in enumerate(self.hosts)}
        self._by_tun = {host.tun: host for host in self.hosts}
        self._flying: list[tuple[float, int, int, bytes]] = []  # time, number, tun, packet
        self._number = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._carry)
        self._began_s = time.monotonic()

    @property
    def now_s(self) -> float:
        """Seconds since it began to carry, or since `restart_clock`."""
        return time.monotonic() - self._began_s

    def restart_clock(self) -> None:
        """Count seconds, those of cuts and of traffic, from now on."""
        self._began_s = time.monotonic()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ending.set()
        self._thread.join()
        self._close_hosts()

    def _close_hosts(self) -> None:
        for host in self.hosts:
            host.close()

    def _carry(self) -> None:
        while not self._ending.is_set():
            due_s = self._flying[0][0] - time.monotonic() if self._flying else _TICK_S
            ready, _, _ = select.select(list(self._lanes), [], [], min(max(due_s, 0.0), _TICK_S))
            for tun in ready:
                _drain(tun, lambda packet, tun=tun: self._take(tun, packet))  # type: ignore[misc]
            self._deliver()

    def _take(self, tun: int, packet: bytes) -> None:
        if packet[0] >> 4 != _IP_VERSION:
            # The kernel's search for IPv6 neighbours.
            return
        # Packets on their way do not know of a restarted clock.
        time_s, began_s, traffic = time.monotonic(), self._began_s, self._by_tun[tun].traffic
        traffic.count(len(packet), time_s - began_s)
        arrivals = self._lanes[tun].carry(len(packet), time_s, began_s)
        traffic.lost += not arrivals
        for target in self._targets(tun, packet):
            for arrival_s in arrivals:
                self._number += 1
                heapq.heappush(self._flying, (arrival_s, self._number, target, packet))

    def _targets(self, tun: int, packet: bytes) -> list[int]:
        """Whom a packet is for: one host, or all others if it is for a group."""
        address = ".".join(map(str, packet[_DESTINATION]))
        others = [host for host in self.hosts if host.tun != tun]
        to_all = packet[_DESTINATION.start] >= 224
        return [host.tun for host in others if to_all or host.address == address]

    def _deliver(self) -> None:
        while self._flying and self._flying[0][0] <= time.monotonic():
            _, _, tun, packet = heapq.heappop(self._flying)
            try:
                os.write(tun, packet)
            except BlockingIOError:
                self._by_tun[tun].traffic.lost += 1


def end(process: subprocess.Popen[bytes], number: int = signal.SIGTERM) -> int:
    """End a host's process and what it started by a signal; its exit code."""
    if process.poll() is None:
        os.killpg(process.pid, number)
        try:
            process.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
    return process.wait()


def _drain(tun: int, take: Callable[[bytes], None]) -> None:
    """Hand over all packets that wait to be read."""
    while True:
        try:
            packet = os.read(tun, _READ_BYTES)
        except BlockingIOError:
            return
        take(packet)
