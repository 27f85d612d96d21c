"""Measures calls over a bad wire: python -m benchmarks reliability FOLDER CLIP... [--only TEXT]...

CLIP: videos.  Encodes each, sends the call over each link of `rows.ROWS` from one network
namespace to another, and prints a table (Linux, root).  A clip that is too short for a row goes
forwards and backwards until it is long enough.  The ends are those of `encode` and `decode`
without encoding and drawing: what arrives, when it does, is played out and drawn afterwards.  Every
row that is measured stays in FOLDER; what is there is not measured again.

up s: from the start of both ends until the encoder has the link measured and may begin.  first s:
from there, where its first face would be found, until the first picture can be drawn.  dB: PSNR of
the face less that of the same call without a wire.  lost: pictures that stand for lost ones.  came:
share of the frame packets; median, p95: their way from one end to the other, ms; those that never
came count as the slowest.  back s: from the end of a cut, or the start of an end that had been
killed, to the first new frame packet.  step: the largest movement of a point of the face from one
picture to the next, as a multiple of that in the call without a wire.  forward, back: bits a second
of IP after the seconds of the model.  No dB is told of calls of more than `PICTURES_S` seconds.
"""

import argparse
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, end
from benchmarks.command import PROGRAM, run
from benchmarks.loss_table import FacePsnr
from benchmarks.measured_process import holds_within
from benchmarks.reliability.clips import long_enough
from benchmarks.reliability.figures import (
    arrivals_of,
    back_after_s,
    clean_arrivals,
    largest_step_px,
    played,
    read_log,
    ways_ms,
)
from benchmarks.reliability.rows import DECODER, ENCODER, RELAY, ROWS, Action, Event, Row
from benchmarks.reliability.tables import COLUMNS, cells_of, markdown_lines, replaced
from benchmarks.simulated_link import sent_packets
from decoder.playout.playout import PlayoutFrame
from encoder.coding.thin_link import startup_rate
from loopback.report import table, write_json
from shared_model.errors import UserError

ADDRESSES, PORT = ("10.77.0.1", "10.77.0.2", "10.77.0.3"), 7447
NEW_ADDRESS = "10.77.0.9"
ENDS = (sys.executable, "-m", "benchmarks.reliability.ends")
# What an encoder measures of a thin link, as a share of its rate; bits and packets a second.
MEASURED_SHARE, FRAMES_BPS, PACKETS_PER_S = 0.85, 800, 3.4
PICTURES_S = 20.0
POLL_S, LIMIT_S = 0.05, 150.0
# By the source of the call.
Faces = dict[Path, FacePsnr]
# The seconds of a call until its model is there, and its last ones, do not count for its rate.
MODEL_S, END_S = 4, 2


def main(argv: Sequence[str]) -> None:
    """Measure what is not measured yet, and print the table."""
    parser = argparse.ArgumentParser(
        prog="reliability",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("clips", nargs="+", type=Path, metavar="CLIP")
    parser.add_argument(
        "--only",
        action="append",
        metavar="TEXT",
        help="rows whose name begins so; may be given more than once",
    )
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="put the rows into the tables of this page, too"
    )
    parser.add_argument("--measured", action="store_true", help="print what is there, no more")
    options = parser.parse_args(argv)
    if reason := obstacle():
        raise UserError(f"no wire can be made here: {reason}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for clip in options.clips:
        rows = [row for row in ROWS if row.name.startswith(tuple(options.only or [""]))]
        faces: Faces = {}
        if options.measured:
            rows = [row for row in rows if _is_measured(row, clip, options.folder)]
        found = [_figures(row, clip, options.folder, faces) for row in rows]
        for each in faces.values():
            each.close()
        cells = [cells_of(row.name, each) for row, each in zip(rows, found, strict=True)]
        print(f"\n{clip.name}\n")
        print(table(COLUMNS, cells))
        if options.page is not None:
            page = options.page.read_text("utf-8")
            options.page.write_text(replaced(page, clip.stem, markdown_lines(cells)), "utf-8")


def _figures(row: Row, clip: Path, folder: Path, faces: Faces) -> list[dict[str, Any]]:
    """Of each call of a row."""
    found = list[dict[str, Any]]()
    for seed in range(1, row.seeds + 1):
        report = _report(row, clip, folder, seed)
        if not report.exists():
            source = long_enough(clip, row.least_s, folder)
            call = _call_of(source, folder, row)
            logs = report.with_suffix("")
            shutil.rmtree(logs, ignore_errors=True)
            logs.mkdir()
            print(f"{clip.name}: {row.name}, {seed}", file=sys.stderr, flush=True)
            traffic = make_call(row, call, logs, seed)
            write_json(report, measure(row, call, source, logs, traffic, faces))
        found.append(json.loads(report.read_text("utf-8")))
    return found


def _report(row: Row, clip: Path, folder: Path, seed: int) -> Path:
    """Where the figures of a call are kept."""
    name = "".join(c if c.isalnum() else "_" for c in f"{clip.stem} {row.name} {seed}")
    return folder / f"{name}.json"


def _is_measured(row: Row, clip: Path, folder: Path) -> bool:
    return all(_report(row, clip, folder, seed + 1).exists() for seed in range(row.seeds))


def _call_of(clip: Path, folder: Path, row: Row) -> Path:
    """The clip as a call file, in layers as an encoder sends them over the link."""
    rate_bps = None
    if row.layers:
        link_bps = MEASURED_SHARE * row.faults.rate_bps
        rate_bps = startup_rate(link_bps, None, FRAMES_BPS, PACKETS_PER_S)
    call = folder / f"{clip.stem}{f'-{rate_bps:.0f}' if rate_bps else ''}.rzo"
    if not call.exists():
        startup = ["--startup-bitrate", f"{rate_bps:.0f}"] if rate_bps else []
        command = [*PROGRAM, "encode", str(clip), "-o", str(call), "--voice", "off", "-q"]
        subprocess.run([*command, *startup], check=True)
    return call


class _Hosts:
    """The processes of a call, each on its host."""

    def __init__(self, row: Row, call: Path, logs: Path, wire: BadWire) -> None:
        self._row, self._call, self._logs, self._wire = row, call, logs, wire
        self._starts = [0] * len(wire.hosts)
        self.processes: dict[int, subprocess.Popen[bytes]] = {}

    @property
    def ends_alive(self) -> bool:
        """Whether the encoder or the decoder still runs."""
        return any(self.processes[host].poll() is None for host in (DECODER, ENCODER))

    def start(self, host: int) -> None:
        """Start what runs on a host, the first time or again."""
        self._starts[host] += 1
        log = self._logs / f"{host}-{self._starts[host]}.log"
        with log.with_suffix(".txt").open("wb") as output:
            self.processes[host] = self._wire.hosts[host].run(self._command(host, log), output)

    def carry_out(self, event: Event) -> None:
        """Do what an event says."""
        if event.action is Action.START:
            self.start(event.host)
        elif event.action is Action.KILL:
            end(self.processes[event.host], signal.SIGKILL)
        else:
            self._wire.hosts[event.host].readdress(NEW_ADDRESS)

    def _command(self, host: int, log: Path) -> list[str]:
        row = self._row
        place = row.endpoint.format(f"{ADDRESSES[RELAY if row.relay else DECODER]}:{PORT}")
        if host == RELAY:
            return [*PROGRAM, "relay", "--listen", place]
        role = "send" if host == ENCODER else "receive"
        how = "connect" if host == ENCODER or row.relay else "listen"
        call = [str(self._call)] if host == ENCODER else []
        return [*ENDS, role, how, place, "sframe" if row.sframe else "insecure", str(log), *call]


def make_call(row: Row, call: Path, logs: Path, seed: int) -> dict[str, Any]:
    """Make one call; when what happened, and the bytes of each second of both ends."""
    with BadWire(ADDRESSES[: 3 if row.relay else 2], row.faults, seed) as wire:
        hosts = _Hosts(row, call, logs, wire)
        for host in ((RELAY,) if row.relay else ()) + (DECODER, ENCODER):
            hosts.start(host)
        holds_within(
            lambda: any(line["what"] == "met" for line in read_log(logs / "1-1.log")), LIMIT_S
        )
        wire.restart_clock()
        for each in wire.hosts:
            each.traffic.bytes_by_second.clear()
        began_s = time.monotonic()
        events = list(row.events)
        while (events or hosts.ends_alive) and wire.now_s < LIMIT_S:
            time.sleep(POLL_S)
            while events and wire.now_s >= events[0].at_s:
                hosts.carry_out(events.pop(0))
        return {
            "began_s": began_s,
            "exit_codes": [hosts.processes[host].poll() for host in (DECODER, ENCODER)],
            "bytes_by_second": [
                dict(wire.hosts[host].traffic.bytes_by_second) for host in (DECODER, ENCODER)
            ],
        }


def measure(
    row: Row, call: Path, clip: Path | None, logs: Path, traffic: dict[str, Any], faces: Faces
) -> dict[str, Any]:
    """The figures of a call that has been made.

    clip: its source; None: it has none, no face is drawn.  faces: kept for later calls.
    """
    sender = read_log(logs / f"{ENCODER}-1.log")
    receiver = [line for path in sorted(logs.glob("0-*.log")) for line in read_log(path)]
    started_s = max(line["t"] for line in (sender[0], receiver[0]))
    met = next((line for line in sender if line["what"] == "met"), None)
    shown, first_s = played(arrivals_of(receiver))
    sent = sent_packets(call)
    clean, _ = played(clean_arrivals(sent))
    figures: dict[str, Any] = {
        "row": asdict(row),
        "exit_codes": traffic["exit_codes"],
        "link_rate_bps": met and met["rate_bps"],
        "up_s": _finite((met["t"] if met else float("inf")) - started_s),
        "first_s": _finite(first_s - met["t"]) if met else None,
        "lost": sum(each.lost for each in shown),
        "back_bps": _rate_bps(traffic["bytes_by_second"][DECODER]),
        "forward_bps": _rate_bps(traffic["bytes_by_second"][ENCODER]),
        **dict.fromkeys(("change_db", "ways_ms", "back_s", "step")),
    }
    if clip is not None and shown:
        figures["step"] = largest_step_px(shown) / largest_step_px(clean)
    is_one_start = all(event.action is Action.MOVE for event in row.events)
    if is_one_start:
        figures["ways_ms"] = ways_ms(sender, receiver)
        if clip is not None and shown and sent[-1].sent_s < PICTURES_S:
            figures["change_db"] = _change_db(shown, clean, clip, faces)
    since = [cut[1] for cut in row.faults.cuts]
    since += [event.at_s for event in row.events if event.action is not Action.KILL]
    if since:
        figures["back_s"] = _finite(back_after_s(receiver, traffic["began_s"] + since[0]))
    return figures


def _change_db(
    shown: Sequence[PlayoutFrame], clean: Sequence[PlayoutFrame], clip: Path, faces: Faces
) -> float:
    if clip not in faces:
        faces[clip] = FacePsnr(str(clip), len(clean))
    return faces[clip].mean_db(shown) - faces[clip].mean_db(clean)


def _rate_bps(by_second: dict[int, int]) -> float | None:
    seconds = range(MODEL_S, max(by_second, default=0) - END_S)
    return 8 * sum(by_second.get(s, 0) for s in seconds) / len(seconds) if seconds else None


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None


if __name__ == "__main__":
    run(main)
