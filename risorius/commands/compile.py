"""`risorius compile`: the encoder's inner loops as machine code, before the first call."""

import argparse
import time
from typing import TYPE_CHECKING

from risorius.command_line.parser import add_command
from risorius.command_line.progress import say
from risorius.command_line.signals import StopOnSignal

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_compile(added: "Commands") -> None:
    """`risorius compile`."""
    parser = add_command(
        added,
        "compile",
        "compile the encoder's inner loops, once on a machine",
        "The first encode does it otherwise.  `make install` runs this command.",
        "  risorius compile\n",
    )
    parser.set_defaults(run=run_compile)


def run_compile(arguments: argparse.Namespace) -> int:
    """`risorius compile`."""
    say("compile: the encoder's inner loops, up to half a minute on a machine that never ran them")
    begin = time.monotonic()
    with StopOnSignal():
        from encoder.live_model.warm_up import compile_loops

        compile_loops()
    say(f"compile: done in {time.monotonic() - begin:.0f} s")
    return 0
