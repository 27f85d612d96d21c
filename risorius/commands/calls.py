"""`risorius calls`: which calls there are."""

import argparse
from typing import TYPE_CHECKING

from risorius.command_line.argument_types import seconds
from risorius.command_line.parser import add_command
from shared_model.errors import LINK_FAILED

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

WAIT_S = 2.0


def add_calls(added: "Commands") -> None:
    """`risorius calls`."""
    parser = add_command(
        added,
        "calls",
        "list the calls on the local network",
        "Whoever listens there for the other end of a call answers: name, address, and who waits.",
        "  risorius calls\n  risorius calls --wait 5\n",
    )
    parser.add_argument(
        "--wait",
        type=seconds,
        default=WAIT_S,
        metavar="S",
        help="wait so long for answers (default: %(default)g)",
    )
    parser.set_defaults(run=run_calls)


def run_calls(arguments: argparse.Namespace) -> int:
    """`risorius calls`: one line for each call; without any exit code 4."""
    lines = _on_local_network(arguments.wait)
    for line in lines:
        print(line)
    if not lines:
        print("no call")
    return 0 if lines else LINK_FAILED


def _on_local_network(wait_s: float) -> list[str]:
    from protocol.discovery import find_calls

    return [
        f"{found.call:20} {found.address:21} {'an encoder' if found.is_encoder else 'a decoder'}"
        f" waits{', invitation needed' if found.needs_invitation else ''}"
        for found in sorted(find_calls(wait_s))
    ]
