"""Runs a command on each of some hosts that one bad wire joins, all on this machine (Linux, root).

    python -m benchmarks bad_wire --loss 5 --delay 50 --cut 20:23 --kill 2:15 --again 2:16 \\
        'risorius decode --listen udp/10.77.0.1:7447 --insecure -o out.mkv' \\
        'risorius encode me.mp4 --connect udp/10.77.0.1:7447 --insecure'

Host 1 has the address 10.77.0.1, host 2 10.77.0.2 and so on.  Each starts STAGGER seconds after
the one before; times are seconds since the last one started.  Prints one line of JSON: for each
host its exit codes and what it has sent: IP packets, bytes, packets lost, bytes of each second.
What the commands print goes to DIR/1.log, DIR/2.log; of a second run to DIR/1-2.log.
"""

import argparse
import json
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults, end
from benchmarks.command import run
from shared_model.errors import UserError

_POLL_S = 0.05


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """At `at_s` seconds host `host` (0 = the first) is killed, or its command runs again."""

    at_s: float
    host: int
    kills: bool


class Runs:
    """The runs of each host's command, one after the other."""

    def __init__(self, wire: BadWire, commands: Sequence[str], logs: Path) -> None:
        self._wire, self._commands, self._logs = wire, commands, logs
        self._runs: list[list[subprocess.Popen[bytes]]] = [[] for _ in commands]

    @property
    def any_alive(self) -> bool:
        """Whether any command still runs."""
        return any(process.poll() is None for runs in self._runs for process in runs)

    @property
    def exit_codes(self) -> list[list[int | None]]:
        """Of each host's runs; None: still running."""
        return [[process.poll() for process in runs] for runs in self._runs]

    def start(self, host: int) -> None:
        """Run a host's command; it finds the number of the run in the environment, as RUN."""
        number = len(self._runs[host]) + 1
        name = f"{host + 1}.log" if number == 1 else f"{host + 1}-{number}.log"
        with open(self._logs / name, "wb") as log:
            process = self._wire.hosts[host].run(
                shlex.split(self._commands[host]), log, os.environ | {"RUN": str(number)}
            )
        self._runs[host].append(process)

    def carry_out(self, event: Event) -> None:
        """Do what an event says."""
        if event.kills:
            end(self._runs[event.host][-1], signal.SIGKILL)
        else:
            self.start(event.host)


def main(argv: Sequence[str]) -> None:
    """Run the commands and print what became of them.  Raises `UserError`."""
    arguments = _parse(argv)
    if reason := obstacle():
        raise UserError(f"no wire can be made here: {reason}")
    arguments.logs.mkdir(parents=True, exist_ok=True)
    addresses = [f"10.77.0.{number + 1}" for number, _ in enumerate(arguments.command)]
    faults = _faults(arguments)
    with BadWire(addresses, faults, arguments.seed) as wire:
        runs = Runs(wire, arguments.command, arguments.logs)
        for host, _ in enumerate(addresses):
            time.sleep(arguments.stagger if host else 0)
            wire.restart_clock()
            runs.start(host)
        _wait(wire, runs, sorted(arguments.kill + arguments.again), arguments.limit)
        print(json.dumps(_figures(wire, runs)))


def _wait(wire: BadWire, runs: Runs, events: list[Event], limit_s: float) -> None:
    while (events or runs.any_alive) and wire.now_s < limit_s:
        time.sleep(_POLL_S)
        while events and wire.now_s >= events[0].at_s:
            runs.carry_out(events.pop(0))


def _figures(wire: BadWire, runs: Runs) -> dict[str, object]:
    hosts = [
        {
            "exit_codes": codes,
            "packets": host.traffic.packets,
            "bytes": host.traffic.bytes,
            "lost": host.traffic.lost,
            "bytes_by_second": dict(sorted(host.traffic.bytes_by_second.items())),
        }
        for host, codes in zip(wire.hosts, runs.exit_codes, strict=True)
    ]
    return {"seconds": round(wire.now_s, 1), "hosts": hosts}


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="bad_wire", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", nargs="+", help="what runs on each host")
    for name, what in (
        ("loss", "percent of the packets that are lost"),
        ("duplicates", "percent of the packets that come twice"),
        ("delay", "milliseconds one way"),
        ("jitter", "milliseconds more or less"),
        ("rate", "bits a second each way"),
    ):
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="N", help=what)
    parser.add_argument("--burst", type=float, default=1.0, help="packets lost in a row, mean")
    parser.add_argument("--queue", type=int, default=0, help="bytes that may wait for the rate")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stagger", type=float, default=3.0, metavar="S")
    parser.add_argument("--limit", type=float, default=300.0, metavar="S", help="end all after S")
    parser.add_argument("--logs", type=Path, default=Path("out/bad_wire"), metavar="DIR")
    parser.add_argument(
        "--cut", type=_span, action="append", default=[], metavar="FROM:TO", help="nothing passes"
    )
    for name, kills in (("kill", True), ("again", False)):
        parser.add_argument(
            f"--{name}",
            type=lambda text, kills=kills: _event(text, kills),  # type: ignore[misc]
            action="append",
            default=[],
            metavar="HOST:S",
        )
    return parser.parse_args(argv)


def _faults(arguments: argparse.Namespace) -> Faults:
    try:
        return Faults(
            loss=arguments.loss / 100,
            burst=arguments.burst,
            delay_ms=arguments.delay,
            jitter_ms=arguments.jitter,
            duplicates=arguments.duplicates / 100,
            rate_bps=arguments.rate,
            queue_bytes=arguments.queue,
            cuts=tuple(arguments.cut),
        )
    except ValueError as error:
        raise UserError(str(error)) from error


def _span(text: str) -> tuple[float, float]:
    start, end_s = map(float, text.split(":"))
    return start, end_s


def _event(text: str, kills: bool) -> Event:
    host, at_s = text.split(":")
    return Event(float(at_s), int(host) - 1, kills)


if __name__ == "__main__":
    run(main)
