"""Runs a program as on a faster host: its clocks go slower (Linux, with a C compiler).

    python -m benchmarks slow_clock SECONDS PROGRAM ...

Python takes SECONDS to add five million times on the host that is asked for.  This one takes
longer: by that ratio all clocks of the program and of what it starts go slower, CPU time too, and
their waits last longer.  So a call in real time has cores as fast as those of that host.
Cores of another kind, their caches and their memory are not imitated.  The rate of the clocks is
printed to standard error.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.command import run
from shared_model.errors import UserError

SOURCE = Path(__file__).with_name("slow_clock.c")
ADDITIONS, TRIES = 5_000_000, 3


def main(argv: Sequence[str]) -> None:
    """Run the program; this one ends with its exit code."""
    parser = argparse.ArgumentParser(
        prog="slow_clock", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("seconds", type=float, metavar="SECONDS")
    parser.add_argument("program", nargs=argparse.REMAINDER, metavar="PROGRAM")
    options = parser.parse_args(argv)
    if not options.program:
        raise UserError("no program is named: slow_clock SECONDS PROGRAM ...")
    taken_s = min(_seconds_of_additions() for _ in range(TRIES))
    rate = options.seconds / taken_s
    if not 0 < rate <= 1:
        raise UserError(f"this host takes {taken_s:.2f} s: clocks are only made slower")
    print(f"{taken_s:.2f} s here: clocks at {rate:.2f} of their rate", file=sys.stderr)
    with TemporaryDirectory() as folder:
        library = Path(folder) / "slow_clock.so"
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
        clocks = f"{rate} {time.monotonic_ns()} {time.time_ns()}"
        environment = os.environ | {"LD_PRELOAD": str(library), "SLOW_CLOCK": clocks}
        sys.exit(subprocess.run(options.program, env=environment, check=False).returncode)


def _seconds_of_additions() -> float:
    start_s, total = time.perf_counter(), 0
    for number in range(ADDITIONS):
        total += number
    return time.perf_counter() - start_s


if __name__ == "__main__":
    run(main)
