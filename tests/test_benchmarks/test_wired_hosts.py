"""Hosts in namespaces of their own, joined by a wire that loses, delays and counts packets."""

import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from processes import until

from benchmarks.bad_wire.__main__ import main
from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults, Host, end

pytestmark = pytest.mark.skipif(obstacle() is not None, reason=str(obstacle()))

ADDRESSES = ("10.77.0.1", "10.77.0.2")
# Prints a line when packets may come, then one for each: its number, when it was sent and when it
# came, seconds.
RECEIVE = """
import socket, time
from contextlib import suppress
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
# SO_RCVBUFFORCE: one that is not served for a while loses nothing.
with suppress(OSError): s.setsockopt(socket.SOL_SOCKET, 33, 1 << 22)
s.bind(("0.0.0.0", 5000))
# JOIN
print("ready", flush=True)
while True:
    number, sent_s = s.recv(2000).split()[:2]
    print(int(number), float(sent_s), time.monotonic(), flush=True)
"""
# Sends COUNT packets of SIZE bytes, INTERVAL seconds apart.
SEND = """
import socket, sys, time
address, count, size, interval = sys.argv[1], *map(float, sys.argv[2:])
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
for number in range(int(count)):
    s.sendto(f"{number} {time.monotonic()} ".encode().ljust(int(size)), (address, 5000))
    time.sleep(interval)
"""
UDP_IP_BYTES = 28


def python(code: str, *arguments: object) -> list[str]:
    return [sys.executable, "-c", code, *map(str, arguments)]


@dataclass(frozen=True, slots=True)
class Came:
    """A packet that came: its number, when it was sent and when it came, seconds."""

    number: int
    sent_s: float
    came_s: float

    @property
    def delay_ms(self) -> float:
        return 1000 * (self.came_s - self.sent_s)


class Receiver:
    """Takes packets on a host, from the time when this returns."""

    def __init__(self, host: Host, log: Path, code: str = RECEIVE) -> None:
        self._log = log
        with log.open("wb") as output:
            self._process = host.run(python(code), output)
        until(lambda: bool(log.read_bytes()), self._still_runs)

    def _still_runs(self) -> None:
        assert self._process.poll() is None, self._log.read_text()

    def packets(self, count: int) -> list[Came]:
        """All that have come once at least so many have."""
        until(lambda: self._log.read_bytes().count(b"\n") > count, self._still_runs)
        end(self._process)
        _, *lines = self._log.read_text().splitlines()
        found = [line.split() for line in lines]
        return [Came(int(number), float(sent), float(came)) for number, sent, came in found]


def send(wire: BadWire, folder: Path, address: str, count: int, interval_s: float = 0.002) -> None:
    """Send packets of 50 bytes from the last host, until the wire has taken them."""
    host = wire.hosts[-1]
    before = host.traffic.packets
    with open(folder / "sent", "wb") as output:
        sender = host.run(python(SEND, address, count, 50, interval_s), output)
    assert sender.wait() == 0, (folder / "sent").read_text()
    until(lambda: host.traffic.packets >= before + count)


def received(wire: BadWire, folder: Path, count: int, interval_s: float = 0.002) -> Sequence[Came]:
    """What came from the second host to the first."""
    receiver, traffic = Receiver(wire.hosts[0], folder / "received"), wire.hosts[1].traffic
    lost = traffic.lost
    send(wire, folder, wire.hosts[0].address, count, interval_s)
    return receiver.packets(count - (traffic.lost - lost))


def test_a_clean_wire_delivers_all_in_order_and_counts_the_bytes(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(delay_ms=30)) as wire:
        found = received(wire, tmp_path, 100)
        traffic = wire.hosts[1].traffic
        assert (traffic.packets, traffic.lost) == (100, 0)
        assert traffic.bytes == 100 * (50 + UDP_IP_BYTES)
        assert sum(traffic.bytes_by_second.values()) == traffic.bytes
    assert [each.number for each in found] == list(range(100))
    assert min(each.delay_ms for each in found) >= 29.9


def test_a_wire_that_is_served_in_time_is_not_late(tmp_path: Path) -> None:
    """On a busy host wire and receiver are late at times; one packet in time is enough."""
    delays = [1000.0]
    with BadWire(ADDRESSES, Faults(delay_ms=30)) as wire:
        until(
            lambda: min(delays) < 45,
            lambda: delays.extend(each.delay_ms for each in received(wire, tmp_path, 100)),
        )
    assert min(delays) >= 29.9


def test_a_lossy_wire_loses_what_its_count_says(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(loss=0.25)) as wire:
        found = received(wire, tmp_path, 400)
        lost = wire.hosts[1].traffic.lost
    assert len(found) == 400 - lost
    assert 60 <= lost <= 140


def test_a_thin_wire_holds_its_rate(tmp_path: Path) -> None:
    """78 bytes of IP, 25 times, take 1.625 s at 9,600 bits a second.

    Until the wire has been served in time once: a busy host only makes it slower.
    """
    took_s = list[float]()

    def carry() -> None:
        found = received(wire, tmp_path, 25)
        assert len(found) == 25
        took_s.append(found[-1].came_s - found[0].sent_s)

    with BadWire(ADDRESSES, Faults(rate_bps=9600)) as wire:
        carry()
        until(lambda: min(took_s) < 1.775, carry)
    assert min(took_s) > 1.624


def test_a_cut_is_counted_from_when_the_clock_was_restarted(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(cuts=((0.0, 3600.0),))) as wire:
        wire.restart_clock()
        send(wire, tmp_path, wire.hosts[0].address, 20, 0)
        assert wire.hosts[1].traffic.lost == 20


def test_a_packet_for_a_group_reaches_all_others(tmp_path: Path) -> None:
    join = RECEIVE.replace(
        "# JOIN",
        "s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,"
        " socket.inet_aton('224.0.0.224') + socket.inet_aton('0.0.0.0'))",
    )
    with BadWire((*ADDRESSES, "10.77.0.3"), Faults()) as wire:
        receivers = [Receiver(host, tmp_path / host.address, join) for host in wire.hosts[:2]]
        send(wire, tmp_path, "224.0.0.224", 3, 0)
        found = [[each.number for each in receiver.packets(3)] for receiver in receivers]
    assert found == [[0, 1, 2], [0, 1, 2]]


def test_a_host_that_has_taken_another_address_is_found_there(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults()) as wire:
        wire.hosts[0].readdress("10.77.0.9")
        assert len(received(wire, tmp_path, 5)) == 5


def test_hosts_reach_nothing_but_each_other(tmp_path: Path) -> None:
    code = """
import errno, socket
try:
    socket.create_connection(("192.0.2.1", 80), 2)
except OSError as error:
    print(errno.errorcode[error.errno])
"""
    with BadWire(ADDRESSES, Faults()) as wire, open(tmp_path / "said", "w+b") as output:
        wire.hosts[0].run(python(code), output).wait()
    assert (tmp_path / "said").read_text() == "ENETUNREACH\n"


def test_nothing_runs_on_after_the_wire(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults()) as wire, open(tmp_path / "said", "wb") as output:
        process = wire.hosts[0].run(python("import time; time.sleep(600)"), output)
    assert process.poll() is not None


def test_a_process_that_does_not_end_by_itself_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.bad_wire.wire.END_PATIENCE_S", 0.1)
    deaf = "import signal, time; signal.signal(15, signal.SIG_IGN); print(1, flush=True)\n"
    host = Host(ADDRESSES[0])
    try:
        with open(tmp_path / "said", "wb") as output:
            process = host.run(python(deaf + "time.sleep(600)"), output)
        while not (tmp_path / "said").read_text():
            assert process.poll() is None
        assert end(process) == -9
    finally:
        host.close()


def test_a_wrong_address_leaves_no_host_behind() -> None:
    with pytest.raises(OSError, match="illegal IP address"):
        BadWire((ADDRESSES[0], "nowhere"), Faults())


def test_the_command_kills_and_runs_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = 'import os, time; print(os.environ["RUN"], flush=True); time.sleep(%s)'
    first_run = tmp_path / "2.log"

    def now_s(wire: BadWire) -> float:
        """A second has passed when the first run has printed its line."""
        return float(first_run.exists() and first_run.read_text() == "1\n")

    monkeypatch.setattr(BadWire, "now_s", property(now_s))
    events = ("--kill", "2:0.5", "--again", "2:0.6")
    sleep = shlex.join(python(code % '600 * (os.environ["RUN"] == "1")'))
    main(["--stagger", "0.1", "--logs", str(tmp_path), *events, "true", sleep])
    first, second = json.loads(capsys.readouterr().out)["hosts"]
    assert first["exit_codes"] == [0]
    assert second["exit_codes"] == [-9, 0]
    assert (tmp_path / "2.log").read_text() == "1\n"
    assert (tmp_path / "2-2.log").read_text() == "2\n"


def test_the_command_says_in_one_line_what_is_wrong() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "benchmarks.bad_wire", "--loss", "100", "true", "true"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert found.returncode == 2
    assert len(found.stderr.splitlines()) == 1
    assert "loss is 1.0" in found.stderr
