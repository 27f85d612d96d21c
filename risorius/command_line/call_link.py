"""Where the other end of a call is: options, calls on the local network, and what is said."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import IPv4Address, ip_address

from protocol.endpoint import DEFAULT_SCHEMES, Endpoint, parse_endpoint
from risorius.command_line.progress import say
from shared_model.errors import LINK_FAILED, UserError

DEFAULT_CALL = "call"
# How long a call is looked for on the local network if nothing else is said.
SEARCH_S = 10.0


@dataclass(frozen=True, slots=True)
class CallLink:
    """Endpoints as the user named them, and the call's name."""

    listen: tuple[str, ...]
    connect: tuple[str, ...]
    call: str


NO_LINK = CallLink((), (), DEFAULT_CALL)


def add_link(parser: argparse.ArgumentParser, where: argparse._MutuallyExclusiveGroup) -> None:
    """The options of `read_link`; endpoints go into the group `where`."""
    for option, what in (
        ("--connect", "where the other end or a relay listens: HOST, HOST:7447, tcp/HOST:7447"),
        ("--listen", "where this end listens: :7447 on all addresses, HOST:7447, tcp/HOST:7447"),
    ):
        where.add_argument(option, action="append", metavar="ENDPOINT", help=what)
    parser.add_argument(
        "--call",
        metavar="NAME",
        help="name on the link, of a-z, A-Z, 0-9 and _ . -; without --connect and --listen the call"
        f" of that name is looked for on the local network (default: {DEFAULT_CALL})",
    )
    parser.add_argument(
        "--insecure",
        action="store_true",
        help="without encryption: as every call over a network at present, with this option or not",
    )


def check_place(arguments: argparse.Namespace, file: str, is_file: bool) -> None:
    """Raise `UserError` if the arguments do not say where the call is.

    file: how the command line names a call file.  is_file: whether there is one.
    """
    if not is_file and not (arguments.connect or arguments.listen or arguments.call):
        raise UserError(
            f"where is the call? give {file}, --connect, --listen or --call; see --help"
        )


def read_link(arguments: argparse.Namespace, is_encoder: bool, wait_s: float) -> CallLink:
    """Endpoints and name of the call that the arguments ask for.

    A call of which only the name is known is looked for on the local network, for `wait_s`, or for
    `SEARCH_S` if that is 0.  Raises `UserError` with exit code 4 if it is not there.
    """
    listen, connect = tuple(arguments.listen or ()), tuple(arguments.connect or ())
    call = arguments.call or DEFAULT_CALL
    if not listen and not connect:
        if not arguments.quiet:
            say(f"looking for call {call!r} on the local network")
        connect = (find_call(call, is_encoder, wait_s or SEARCH_S),)
    return CallLink(listen, connect, call)


def find_call(call: str, is_encoder: bool, wait_s: float) -> str:
    """Address of the end that waits on the local network for this end of a call.

    Raises `UserError` with exit code 4 if there is none within `wait_s`.
    """
    from protocol.discovery import find_calls

    others = set[str]()
    for found in find_calls(wait_s):
        if found.call == call and found.is_encoder != is_encoder:
            return found.address
        others.add(f"{'an encoder' if found.is_encoder else 'a decoder'} of call {found.call!r}")
    who = f"; there is {', '.join(sorted(others))}" if others else ""
    end = "a decoder" if is_encoder else "an encoder"
    raise UserError(
        f"{end} of call {call!r} does not listen on the local network{who}", LINK_FAILED
    )


@contextmanager
def announced(link: CallLink, is_encoder: bool) -> Iterator[None]:
    """Answer within the `with` block who looks for calls on the local network.

    An end that does not listen beyond this host, or not over UDP or TCP, does not answer.
    """
    place = next(filter(_is_open, map(parse_endpoint, link.listen)), None)
    if place is None:
        yield
        return
    from protocol.discovery import CallAnnouncer, FoundCall

    found = FoundCall(link.call, "", place.port, is_encoder, needs_invitation=False)
    with CallAnnouncer(found, _interface(place)):
        yield


def _is_open(place: Endpoint) -> bool:
    """Whether who is on the local network can connect to it by its address alone."""
    is_default = place.scheme is None or place.scheme in DEFAULT_SCHEMES
    return is_default and not place.is_loopback and bool(place.port)


def _interface(place: Endpoint) -> str | None:
    """The address of the one network interface that is listened on; None: all, or not known."""
    try:
        is_one = isinstance(ip_address(place.host), IPv4Address) and not place.is_any
    except ValueError:
        return None
    return place.host if is_one else None
