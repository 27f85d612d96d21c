"""`risorius relay`: a router between hosts that can only connect out."""

import argparse
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from risorius.command_line.parser import add_command
from risorius.command_line.progress import say
from risorius.command_line.signals import StopOnSignal

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

NAP_S = 0.2


def add_relay(added: "Commands") -> None:
    """`risorius relay`."""
    parser = add_command(
        added,
        "relay",
        "pass calls on between hosts that can only connect out",
        "A Zenoh router: encoder and decoder both --connect to it.  Runs until it is stopped.",
        "  risorius relay --listen tcp/0.0.0.0:7447\n",
    )
    parser.add_argument(
        "--listen",
        action="append",
        required=True,
        metavar="ENDPOINT",
        help="Zenoh endpoint, as tcp/0.0.0.0:7447",
    )
    parser.set_defaults(run=run_relay)


def run_relay(arguments: argparse.Namespace) -> int:
    """`risorius relay`: being stopped is its normal end."""
    from protocol.link.zenoh_link import ZenohRouter

    with StopOnSignal(), suppress(KeyboardInterrupt), ZenohRouter(tuple(arguments.listen)):
        say(f"relay: listening on {' '.join(arguments.listen)}")
        while True:
            # Not for a signal: a thread of Zenoh may take it.
            time.sleep(NAP_S)
    return 0
