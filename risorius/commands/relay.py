"""`risorius relay`: a router between hosts that can only connect out."""

import argparse
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from protocol.endpoint import parse_remote_endpoint
from protocol.limits import RELAY_PEERS
from risorius.command_line.argument_types import peers, port
from risorius.command_line.parser import add_command
from risorius.command_line.progress import say
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from protocol.relay.zenoh_relay import RelayOptions
    from risorius.command_line.parser import Commands

NAP_S = 0.2


def add_relay(added: "Commands") -> None:
    """`risorius relay`."""
    parser = add_command(
        added,
        "relay",
        "pass calls on between hosts that can only connect out",
        "A Zenoh router: encoder and decoder both --connect to it.  Runs until it is stopped.\n"
        "With --keys only peers with a certificate get in, and each may do what it was invited\n"
        "to.  Relays that connect to each other (--connect) pass calls on between them.  With\n"
        "--watch browsers watch the calls at http://HOST:PORT/CALL#KEY; the relay, which is never\n"
        "told the key, cannot.",
        "  risorius relay --listen :7447\n"
        "  risorius relay --listen tls/:7447 --listen quic/:7448 --keys relay-keys\n"
        "  risorius relay --listen :7447 --connect relay.example:7447\n"
        "  risorius relay --listen :7447 --watch 8080\n",
    )
    parser.add_argument(
        "--listen",
        action="append",
        required=True,
        metavar="ENDPOINT",
        help="as :7447 or tcp/HOST:7447; may be given several times",
    )
    parser.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help="another relay to join"
    )
    parser.add_argument(
        "--keys",
        type=Path,
        metavar="FOLDER",
        help="folder of risorius keys: mutual TLS, on tls/ and quic/ endpoints only",
    )
    parser.add_argument(
        "--max-peers",
        type=peers,
        default=RELAY_PEERS,
        metavar="N",
        help="connections at a time (default: %(default)s)",
    )
    parser.add_argument(
        "--watch",
        type=port,
        metavar="PORT",
        help="serve a page to browsers that watch calls, on this TCP port; 0: any free one",
    )
    parser.set_defaults(run=run_relay)


def run_relay(arguments: argparse.Namespace) -> int:
    """`risorius relay`: being stopped is its normal end."""
    from protocol.relay.zenoh_relay import RelayOptions, check_certified

    folder: Path | None = arguments.keys
    watch: int | None = arguments.watch
    if folder is not None and watch is not None:
        raise UserError("--watch does not go with --keys: who watches has no certificate")
    listen, connect = tuple(arguments.listen), tuple(arguments.connect or ())
    options = RelayOptions(listen, connect, arguments.max_peers)
    if folder is not None:
        check_certified(listen + connect)
    with StopOnSignal(), suppress(KeyboardInterrupt):
        news = "listening on " + " ".join(listen)
        while True:
            _relay(options, folder, watch, news)
            news = "the keys have changed"
    return 0


def _relay(options: "RelayOptions", folder: Path | None, watch: int | None, news: str) -> None:
    """Relay until the keys in `folder` change; say `news` as soon as it does.

    Zenoh reads whom to let in when it starts; peers come back by themselves.
    """
    from protocol.link.endpoints import Failure, why_not_reached
    from protocol.relay.zenoh_relay import Relay
    from protocol.security.authority import RELAY_KEYS, read_peers
    from protocol.security.key_file import read_key_file

    if folder is not None:
        invited = read_peers(folder)
        options = replace(options, keys=read_key_file(folder / RELAY_KEYS), peers=invited)
    with ExitStack() as stack:
        relay = stack.enter_context(Relay(options))
        say(f"relay: {news}")
        if watch is not None:
            from risorius.watch.watch_server import WatchServer

            server = stack.enter_context(WatchServer(relay, watch))
            say(f"relay: calls are watched at http://HOST:{server.port}/CALL#KEY")
        for text in options.connect:
            # The last choice is the one that a relay takes to another.
            why = why_not_reached(parse_remote_endpoint(text).choices[-1])
            if why not in (Failure.FOREIGN, Failure.SILENT):
                say(f"relay: cannot reach {text}: {why}; trying again")
        while folder is None or read_peers(folder) == options.peers:
            # Not for a signal: a thread of Zenoh may take it.
            time.sleep(NAP_S)
