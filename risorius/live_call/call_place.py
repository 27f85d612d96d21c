"""Where the other end of a call is, as the command line says it, and with what key."""

import argparse
from pathlib import Path

from protocol.endpoint import parse_endpoint
from protocol.link.interface import LinkOptions
from protocol.security.invitation import SCHEME, Invitation
from risorius.command_line.argument_types import seconds
from risorius.command_line.call_link import LinkRequest, read_link
from risorius.command_line.progress import say
from risorius.live_call.invitation_card import command_line, own_host


def add_place(parser: argparse.ArgumentParser) -> None:
    """The options of `read_place`."""
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "address",
        nargs="?",
        metavar="INVITATION",
        help="the line that the other end has printed; or HOST:PORT, where it listens",
    )
    where.add_argument(
        "--listen", metavar="[HOST]:PORT", help="wait for the other end here, and print the line"
    )
    keys = parser.add_mutually_exclusive_group()
    keys.add_argument(
        "--invite-file",
        type=Path,
        metavar="FILE",
        help="file with the invitation; with --listen one that does not exist yet is written",
    )
    keys.add_argument(
        "--insecure",
        action="store_true",
        help="without encryption beyond this host: whoever is on the way can watch and forge",
    )
    parser.add_argument(
        "--call",
        metavar="NAME",
        help="name of the call, of a-z, A-Z, 0-9 and _ . - (default: that of the invitation)",
    )
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=0.0,
        metavar="S",
        help="give up after S seconds if nobody listens there; 0: after 10 (default: 0)",
    )


def read_place(arguments: argparse.Namespace) -> tuple[LinkOptions, str | None]:
    """The link that the arguments ask for, and what to hand over: an invitation, or without a key
    what the other end types; None: nothing.  Prints it, but for an invitation that is not new.

    Raises `UserError` if something is missing, or does not go together.
    """
    address: str | None = arguments.address
    is_invitation = address is not None and address.lower().startswith(f"{SCHEME}:")
    link = read_link(
        LinkRequest(
            listen=() if arguments.listen is None else (arguments.listen,),
            connect=() if address is None or is_invitation else (address,),
            invite=address if is_invitation else None,
            invite_file=arguments.invite_file,
            insecure=arguments.insecure,
            call=arguments.call,
        ),
        is_encoder=True,
        wait_s=arguments.timeout,
    )
    to_hand_over = _to_hand_over(link, arguments.insecure)
    if link.security.key is None and to_hand_over is not None:
        say(f"the other end types: {to_hand_over}")
    return link, to_hand_over


def own_address(listen: str) -> str:
    """The endpoint by which this host reaches itself where it listens on `listen`."""
    endpoint = parse_endpoint(listen)
    if not endpoint.is_any:
        return listen
    scheme = "" if endpoint.scheme is None else f"{endpoint.scheme}/"
    host = "[::1]" if ":" in endpoint.host else "127.0.0.1"
    return f"{scheme}{host}:{endpoint.port}{endpoint.options}"


def _to_hand_over(link: LinkOptions, is_insecure: bool) -> str | None:
    """The invitation, or without a key what the other end types."""
    if not link.listen:
        return None
    place = parse_endpoint(link.listen[0])
    if link.security.key is None:
        return command_line(place, link.call, is_insecure)
    host = own_host(place)
    return None if host is None else str(Invitation(host, place.port, link.call, link.security.key))
