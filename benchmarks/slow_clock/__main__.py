"""Runs a program as on a faster host: its clocks go slower (Linux, with a C compiler).

    python -m benchmarks slow_clock RATE PROGRAM ...

All clocks of the program and of what it starts go on by RATE (0 to 1) of what the real ones do, CPU
time too, and their waits last longer.  So a call in real time has cores 1 / RATE times as fast.
Caches and memory are not imitated.  Which RATE imitates another host tells a program whose time is
known there.
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


def main(argv: Sequence[str]) -> None:
    """Run the program; this one ends with its exit code."""
    parser = argparse.ArgumentParser(
        prog="slow_clock", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("rate", type=float, metavar="RATE")
    parser.add_argument("program", nargs=argparse.REMAINDER, metavar="PROGRAM")
    options = parser.parse_args(argv)
    if not options.program:
        raise UserError("no program is named: slow_clock RATE PROGRAM ...")
    if not 0 < options.rate <= 1:
        raise UserError(f"a rate of {options.rate:g}: clocks are only made slower, 0 to 1")
    with TemporaryDirectory() as folder:
        library = Path(folder) / "slow_clock.so"
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
        clocks = f"{options.rate} {time.monotonic_ns()} {time.time_ns()}"
        environment = os.environ | {"LD_PRELOAD": str(library), "SLOW_CLOCK": clocks}
        sys.exit(subprocess.run(options.program, env=environment, check=False).returncode)


if __name__ == "__main__":
    run(main)
