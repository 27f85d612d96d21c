"""`risorius calls`: which calls there are."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.argument_types import seconds
from risorius.command_line.parser import add_command

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

WAIT_S = 2.0


def add_calls(added: "Commands") -> None:
    """`risorius calls`."""
    parser = add_command(
        added,
        "calls",
        "list the calls on the local network, or at a relay",
        "On the local network whoever listens answers, with the address.  A relay tells the calls\n"
        "whose ends are connected to it; one with certificates tells its owner alone.",
        "  risorius calls\n"
        "  risorius calls --connect relay.example:7447\n"
        "  risorius calls --connect tls/relay.example:7447 --keys relay-keys/relay.keys\n",
    )
    parser.add_argument("--connect", metavar="ENDPOINT", help="where a relay listens")
    parser.add_argument("--keys", type=Path, metavar="FILE", help="key file for the relay")
    parser.add_argument(
        "--wait",
        type=seconds,
        default=WAIT_S,
        metavar="S",
        help="on the local network, wait so long for answers (default: %(default)g)",
    )
    parser.set_defaults(run=run_calls)


def run_calls(arguments: argparse.Namespace) -> int:
    """`risorius calls`: one line for each call; that there is none is no failure."""
    lines = _at_relay(arguments) if arguments.connect else _on_local_network(arguments.wait)
    for line in lines:
        print(line)
    if not lines:
        print("no call")
    return 0


def _on_local_network(wait_s: float) -> list[str]:
    from protocol.discovery import find_calls

    return [
        f"{found.call:20} {found.address:21} {'an encoder' if found.is_encoder else 'a decoder'}"
        f" waits{', invitation needed' if found.needs_invitation else ''}"
        for found in sorted(find_calls(wait_s))
    ]


def _at_relay(arguments: argparse.Namespace) -> list[str]:
    from protocol.relay.zenoh_relay import calls_at_relay
    from protocol.security.key_file import read_key_file

    keys = read_key_file(arguments.keys) if arguments.keys else None
    return [
        f"{call.name:20} {call.encoders} encoder{'s' if call.encoders != 1 else ''},"
        f" {call.decoders} decoder{'s' if call.decoders != 1 else ''}"
        for call in calls_at_relay(arguments.connect, keys)
    ]
