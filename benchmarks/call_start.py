"""How soon a call begins: from starting an end until the other one, who waits, sees a face (Linux).

    python -m benchmarks call_start CLIP [--runs N] [--busy N]

One end listens and waits, with a camera that sees nobody, until it is ready; then another one
calls it, with CLIP for a camera.  No page is open.  Prints a line of JSON, medians over the runs
in seconds:

    page_s   from the start of the one who calls until its page is there
    seen_s   until the one who waits has its first face
    cpu_s    CPU time of all processes of the one who calls until then
"""

import argparse
import asyncio
import json
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.call_delay.clip import write_empty_clip
from benchmarks.call_ends import first_told, line_with, page_of, start_end
from benchmarks.command import run
from benchmarks.measured_process import cpu_s
from loopback.process_pair import busy_loops, free_port

RUNS = 5
# What an end says in the terminal when it sees the other one, and on its page when it is ready.
SEEN, READY = "is here", "looking for your face"


@dataclass(frozen=True, slots=True)
class Start:
    """How one call has begun; see above."""

    page_s: float
    seen_s: float
    cpu_s: float


def main(argv: Sequence[str]) -> None:
    """Print the figures of some calls."""
    parser = argparse.ArgumentParser(
        prog="call_start", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("clip", type=Path, metavar="CLIP")
    parser.add_argument("--runs", type=int, default=RUNS, metavar="N")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy loops beside it")
    options = parser.parse_args(argv)
    with TemporaryDirectory() as name:
        nobody = write_empty_clip(Path(name))
        starts = [measure(options.clip, nobody, options.busy) for _ in range(options.runs)]
    figures = {
        each: round(median(getattr(start, each) for start in starts), 2) for each in Start.__slots__
    }
    print(json.dumps({**figures, "seen_s of each": [round(each.seen_s, 2) for each in starts]}))


def measure(clip: Path, nobody: Path, busy: int) -> Start:
    """Let one end call another.  clip, nobody: their cameras.  busy: loops beside it."""
    with ExitStack() as stack:
        where = f"127.0.0.1:{free_port()}"
        waits = start_end(stack, "--listen", where, "--camera", str(nobody))
        asyncio.run(first_told(page_of(waits), _is_ready))
        stack.enter_context(busy_loops(busy))
        start_s = time.monotonic()
        calls = start_end(stack, where, "--camera", str(clip))
        page_of(calls)
        page_s = time.monotonic() - start_s
        line_with(waits, SEEN)
        seen_s = time.monotonic() - start_s
        return Start(page_s, seen_s, _cpu_of_family_s(calls.pid))


def _is_ready(told: dict[str, Any]) -> bool | None:
    return True if told["kind"] == "costs" and READY in told["text"] else None


def _cpu_of_family_s(pid: int) -> float:
    """CPU time so far of a process and all that it and they have started."""
    parents = dict[int, int]()
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (path / "stat").read_text().rpartition(")")[2].split()
            parents[int(path.name)] = int(fields[1])
    family, grown = {pid}, True
    while grown:
        more = {each for each, parent in parents.items() if parent in family} - family
        family, grown = family | more, bool(more)
    return sum(cpu_s(each) for each in family)


if __name__ == "__main__":
    run(main)
