"""Hosts in namespaces of their own, joined by a wire that loses, delays and counts packets."""

import json
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from loopback.bad_wire import BadWire, Faults, Host, Lane, end
from loopback.network_namespace import TUN_DEVICE, obstacle
from scripts.bad_wire import main

ADDRESSES = ("10.77.0.1", "10.77.0.2")
OBSTACLE = obstacle()
needs_wire = pytest.mark.skipif(OBSTACLE is not None, reason=OBSTACLE or "")
# Takes packets until none has come for a second, then prints the delay of each, ms, in the order
# of arrival, and its number.
RECEIVE = """
import json, socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("0.0.0.0", 5000))
s.settimeout(20)
found = []
try:
    while True:
        number, sent_s = s.recv(2000).split()[:2]
        found.append((int(number), 1000 * (time.monotonic() - float(sent_s))))
        s.settimeout(1)
except TimeoutError:
    print(json.dumps(found))
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


def received(
    wire: BadWire, folder: Path, count: int, size: int = 50, interval_s: float = 0.002
) -> list[tuple[int, float]]:
    """Number and delay, ms, of each packet that came from the second host to the first."""
    with open(folder / "received", "wb") as output, open(folder / "sent", "wb") as nothing:
        receiver = wire.hosts[0].run(python(RECEIVE), output)
        # The receiver may not be there yet: what is sent before it is has no effect on it.
        ready = wire.hosts[0].run(python("import time; time.sleep(.5)"), nothing)
        ready.wait()
        sender = wire.hosts[1].run(
            python(SEND, wire.hosts[0].address, count, size, interval_s), nothing
        )
        assert sender.wait() == 0, (folder / "sent").read_text()
        assert receiver.wait() == 0
    return [(number, delay) for number, delay in json.loads((folder / "received").read_text())]


def fates(faults: Faults, count: int, seed: int = 1) -> list[tuple[float, ...]]:
    """Arrivals of packets of 100 bytes, sent 10 ms apart."""
    lane = Lane(faults, seed)
    return [lane.carry(100, 0.01 * number) for number in range(count)]


def test_a_wire_without_faults_delivers_each_packet_at_once() -> None:
    assert fates(Faults(), 50) == [(0.01 * number,) for number in range(50)]


def test_the_same_seed_gives_the_same_fates() -> None:
    faults = Faults(loss=0.2, burst=2, delay_ms=20, jitter_ms=10, duplicates=0.1)
    assert fates(faults, 500) == fates(faults, 500)
    assert fates(faults, 500) != fates(faults, 500, seed=2)


def test_single_losses_have_the_share_asked_for() -> None:
    lost = [not arrivals for arrivals in fates(Faults(loss=0.25), 20_000)]
    assert sum(lost) / len(lost) == pytest.approx(0.25, abs=0.01)
    after_lost = [now for before, now in pairwise(lost) if before]
    assert sum(after_lost) / len(after_lost) == pytest.approx(0.25, abs=0.02)


def test_bursts_have_the_share_and_the_mean_length_asked_for() -> None:
    lost = [not arrivals for arrivals in fates(Faults(loss=0.1, burst=3), 50_000)]
    begun = sum(now and not before for before, now in pairwise(lost))
    assert sum(lost) / len(lost) == pytest.approx(0.1, abs=0.01)
    assert sum(lost) / begun == pytest.approx(3, abs=0.15)


def test_jitter_stays_within_its_bounds_and_puts_packets_out_of_order() -> None:
    arrivals = [each[0] for each in fates(Faults(delay_ms=50, jitter_ms=20), 1000)]
    delays = [at - 0.01 * number for number, at in enumerate(arrivals)]
    assert 0.03 <= min(delays) < 0.032
    assert 0.068 < max(delays) <= 0.07
    assert arrivals != sorted(arrivals)


def test_no_packet_arrives_before_it_was_sent() -> None:
    arrivals = fates(Faults(delay_ms=5, jitter_ms=50), 500)
    assert all(each[0] >= 0.01 * number for number, each in enumerate(arrivals))


def test_some_packets_come_twice() -> None:
    twice = [len(arrivals) == 2 for arrivals in fates(Faults(duplicates=0.05), 20_000)]
    assert sum(twice) / len(twice) == pytest.approx(0.05, abs=0.005)


def test_packets_wait_for_the_rate() -> None:
    """100 bytes take 100 ms at 8,000 bits a second."""
    arrivals = [each[0] for each in fates(Faults(rate_bps=8000), 20)]
    assert arrivals == pytest.approx([0.1 * (number + 1) for number in range(20)])


def test_a_full_queue_loses_what_comes_then() -> None:
    arrivals = fates(Faults(rate_bps=8000, queue_bytes=250), 100)
    assert 10 <= sum(map(len, arrivals)) <= 13
    assert max(each[0] - 0.01 * n for n, each in enumerate(arrivals) if each) <= 0.25 + 1e-9


def test_nothing_passes_during_a_cut() -> None:
    arrivals = fates(Faults(cuts=((0.1, 0.2), (0.5, 0.6))), 100)
    lost = [number for number, each in enumerate(arrivals) if not each]
    assert lost == [*range(10, 20), *range(50, 60)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"loss": 1.0},
        {"loss": -0.1},
        {"duplicates": 1.5},
        {"delay_ms": -1.0},
        {"jitter_ms": -1.0},
        {"rate_bps": -1.0},
        {"queue_bytes": -1},
        {"burst": 0.5},
        {"cuts": ((3.0, 2.0),)},
    ],
)
def test_faults_that_cannot_be_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).partition("_")[0].rstrip("s")):
        Faults(**wrong)  # type: ignore[arg-type]


def test_no_wire_without_the_device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("loopback.network_namespace.TUN_DEVICE", tmp_path / "tun")
    assert obstacle() == f"there is no {tmp_path / 'tun'}"
    assert TUN_DEVICE.name == "tun"


@needs_wire
def test_a_clean_wire_delivers_all_in_order_and_counts_the_bytes(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(delay_ms=30)) as wire:
        found = received(wire, tmp_path, 100)
        traffic = wire.hosts[1].traffic
        assert (traffic.packets, traffic.lost) == (100, 0)
        assert traffic.bytes == 100 * (50 + UDP_IP_BYTES)
        assert sum(traffic.bytes_by_second.values()) == traffic.bytes
    assert [number for number, _ in found] == list(range(100))
    # The receiver may be late; the wire is not.
    assert 29.9 <= min(delay for _, delay in found) < 45


@needs_wire
def test_a_lossy_wire_loses_what_its_count_says(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(loss=0.25)) as wire:
        found = received(wire, tmp_path, 400)
        lost = wire.hosts[1].traffic.lost
    assert len(found) == 400 - lost
    assert 60 <= lost <= 140


@needs_wire
def test_a_thin_wire_holds_its_rate(tmp_path: Path) -> None:
    """78 bytes of IP, 25 times, take 1.625 s at 9,600 bits a second."""
    with BadWire(ADDRESSES, Faults(rate_bps=9600)) as wire:
        found = received(wire, tmp_path, 25)
    assert len(found) == 25
    assert found[-1][1] == pytest.approx(1625 - 25 * 2, abs=150)


@needs_wire
def test_a_cut_is_counted_from_when_the_clock_was_restarted(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults(cuts=((0.0, 3600.0),))) as wire:
        wire.restart_clock()
        with open(tmp_path / "sent", "wb") as output:
            wire.hosts[1].run(python(SEND, wire.hosts[0].address, 20, 50, 0), output).wait()
        # The last of them may be on its way into the wire.
        with open(tmp_path / "wait", "wb") as output:
            wire.hosts[1].run(python("import time; time.sleep(.3)"), output).wait()
        assert wire.hosts[1].traffic.lost == 20


@needs_wire
def test_a_packet_for_a_group_reaches_all_others(tmp_path: Path) -> None:
    join = RECEIVE.replace(
        "s.settimeout(20)",
        "s.settimeout(20)\n"
        "s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,"
        " socket.inet_aton('224.0.0.224') + socket.inet_aton('0.0.0.0'))",
    )
    with BadWire((*ADDRESSES, "10.77.0.3"), Faults()) as wire:
        receivers = []
        for host in wire.hosts[:2]:
            with open(tmp_path / host.address, "wb") as output:
                receivers.append(host.run(python(join), output))
        with open(tmp_path / "sent", "wb") as output:
            pause = "import time; time.sleep(.7)\n"
            wire.hosts[2].run(python(pause + SEND, "224.0.0.224", 3, 50, 0), output).wait()
        assert [process.wait() for process in receivers] == [0, 0]
    for address in ADDRESSES:
        found = json.loads((tmp_path / address).read_text())
        assert [number for number, _ in found] == [0, 1, 2]


@needs_wire
def test_a_host_that_has_taken_another_address_is_found_there(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults()) as wire:
        wire.hosts[0].readdress("10.77.0.9")
        assert len(received(wire, tmp_path, 5)) == 5


@needs_wire
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


@needs_wire
def test_nothing_runs_on_after_the_wire(tmp_path: Path) -> None:
    with BadWire(ADDRESSES, Faults()) as wire, open(tmp_path / "said", "wb") as output:
        process = wire.hosts[0].run(python("import time; time.sleep(600)"), output)
    assert process.poll() is not None


@needs_wire
def test_a_process_that_does_not_end_by_itself_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("loopback.bad_wire.END_PATIENCE_S", 0.1)
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


@needs_wire
def test_a_wrong_address_leaves_no_host_behind() -> None:
    with pytest.raises(OSError, match="illegal IP address"):
        BadWire((ADDRESSES[0], "nowhere"), Faults())


@needs_wire
def test_the_command_kills_and_runs_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = 'import os, time; print(os.environ["RUN"], flush=True); time.sleep(1)'
    events = ("--kill", "2:0.5", "--again", "2:0.6")
    sleep = shlex.join(python(code))
    main(["--stagger", "0.1", "--logs", str(tmp_path), *events, "true", sleep])
    first, second = json.loads(capsys.readouterr().out)["hosts"]
    assert first["exit_codes"] == [0]
    assert second["exit_codes"] == [-9, 0]
    assert (tmp_path / "2.log").read_text() == "1\n"
    assert (tmp_path / "2-2.log").read_text() == "2\n"


@needs_wire
def test_the_command_says_in_one_line_what_is_wrong() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "scripts.bad_wire", "--loss", "100", "true", "true"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert found.returncode == 2
    assert len(found.stderr.splitlines()) == 1
    assert "loss is 1.0" in found.stderr
