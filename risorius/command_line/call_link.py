"""Where the other end of a call is, and with what keys: options, invitations, and what is said.

Whoever listens beyond this host draws a key and prints an invitation; whoever connects beyond this
host has been given one.  `--insecure` and loopback go without, and say so.
"""

import argparse
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from protocol.endpoint import (
    CERTIFIED_SCHEMES,
    DEFAULT_SCHEMES,
    DEVICE_FORMS,
    Endpoint,
    address_for_others,
    parse_endpoint,
    parse_remote_endpoint,
)
from protocol.errors import ProtocolError
from protocol.limits import CALL_NAME, CALL_NAME_RULE, DEFAULT_CALL, DEFAULT_PORT
from protocol.link.endpoints import check_listening
from protocol.link.interface import CONNECT_TIMEOUT_S, LinkOptions
from protocol.security.invitation import Invitation, parse_invitation, random_key
from protocol.security.link_security import KeyFile, LinkSecurity
from risorius.command_line.local_network import find_call
from risorius.command_line.progress import say
from shared_model.errors import UserError

# What an invitation says of a device, which has no address: the other end names its own.
DEVICE_HOST = "localhost"
LINK_OPTIONS = ("connect", "listen", "invite", "invite_file", "call")
# Names that are drawn: two syllables, easily said over a telephone.
_CONSONANTS, _VOWELS = "bdfgjklmnprstv", "aeiou"

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class LinkRequest:
    """What the user says of a link, see `add_link`.  quiet: nothing is printed of it."""

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    invite: str | None = None
    invite_file: Path | None = None
    insecure: bool = False
    keys: Path | None = None
    call: str | None = None
    quiet: bool = False


def add_link(parser: argparse.ArgumentParser, where: argparse._MutuallyExclusiveGroup) -> None:
    """The options of `link_request`; endpoints go into the group `where`."""
    for option, what in (
        (
            "--connect",
            f"where the other end or a relay listens: HOST, HOST:7447, tls/HOST, {DEVICE_FORMS}",
        ),
        (
            "--listen",
            f"where this end listens: :7447 on all addresses, HOST:7447, {DEVICE_FORMS}",
        ),
    ):
        where.add_argument(option, action="append", metavar="ENDPOINT", help=what)
    link = parser.add_argument_group("over a network")
    invitation = link.add_mutually_exclusive_group()
    invitation.add_argument(
        "--invite", metavar="LINE", help="the invitation that the other end has printed"
    )
    invitation.add_argument(
        "--invite-file",
        type=Path,
        metavar="FILE",
        help="file with the invitation, which then does not stand in the list of processes; with"
        " --listen a file that does not exist yet is written",
    )
    invitation.add_argument(
        "--insecure",
        action="store_true",
        help="without encryption beyond this host: whoever is on the way can watch and forge",
    )
    link.add_argument(
        "--keys",
        type=Path,
        metavar="FILE",
        help="key file for tls/ and quic/ endpoints, as the owner of a relay hands it out",
    )
    link.add_argument(
        "--call",
        metavar="NAME",
        help="name on the link, of a-z, A-Z, 0-9 and _ . - (default: that of the invitation, else"
        f" {DEFAULT_CALL}); alone, with --insecure: look for it on the local network",
    )


def check_place(arguments: argparse.Namespace, file: str, is_file: bool) -> None:
    """Raise `UserError` unless the arguments name either a call file or a link.

    file: how the command line names a call file.  is_file: whether there is one.
    """
    link = next((name for name in LINK_OPTIONS if getattr(arguments, name)), None)
    if is_file and link is not None:
        option = f"--{link.replace('_', '-')}"
        raise UserError(f"{option} does not go with {file}; leave out {option}")
    if not is_file and link is None:
        raise UserError(
            f"where is the call? give {file}, --connect, --listen or --invite; see --help"
        )


def check_ports(arguments: argparse.Namespace) -> None:
    """Raise `UserError` with exit code 4 where this end cannot listen, or its page be served."""
    check_listening(arguments.listen or ())
    if arguments.view:
        from risorius.page.access import check_port

        check_port(arguments.port)


def link_request(arguments: argparse.Namespace) -> LinkRequest:
    """What the arguments of `add_link` ask for."""
    return LinkRequest(
        listen=tuple(arguments.listen or ()),
        connect=tuple(arguments.connect or ()),
        invite=arguments.invite,
        invite_file=arguments.invite_file,
        insecure=arguments.insecure,
        keys=arguments.keys,
        call=arguments.call,
        quiet=arguments.quiet,
    )


def read_link(request: LinkRequest, is_encoder: bool, wait_s: float) -> LinkOptions:
    """Endpoints, name and keys of the call that is asked for.

    Prints the invitation, if there is a new one, or that the call is not encrypted.  A call of
    which only the name is known is looked for on the local network.
    wait_s: time limit for that, and for connecting; 0: the usual ones.
    Raises `UserError` if something is missing, or does not go together.
    """
    tell = _ignore if request.quiet else say
    check_call_name(request.call)
    _check_certificate(request)
    invitation = _given_invitation(request)
    listen = tuple(map(parse_endpoint, request.listen))
    wants_key = request.invite_file is not None or _needs_key(request, listen)
    if listen and invitation is None and wants_key:
        invitation = _new_invitation(request, listen, tell)
    name = request.call or (DEFAULT_CALL if invitation is None else invitation.call)
    if invitation is not None and name != invitation.call:
        raise UserError(f"the invitation is to call {invitation.call!r}; leave out --call")
    connect = request.connect
    is_looked_for = invitation is None and not listen and not connect
    if not listen and not connect:
        connect = (_place(invitation, name, is_encoder, wait_s, tell),)
    if invitation is None:
        _check_open(request, connect)
        tell(f"this call is not encrypted: {_why_open(request)}")
    key = None if invitation is None else invitation.key
    security = LinkSecurity(key, _key_file(request.keys), trusts_network=is_looked_for)
    return LinkOptions(
        name, request.listen, connect, wait_s or CONNECT_TIMEOUT_S, security=security
    )


def check_call_name(name: str | None) -> None:
    """Raise `UserError` if a name is given that no call can have."""
    if name is not None and not CALL_NAME.fullmatch(name):
        raise UserError(f"call name {name!r}: {CALL_NAME_RULE}")


def random_call_name() -> str:
    """A name that no other call around is likely to have; no secret."""
    letters = (_CONSONANTS, _VOWELS, _CONSONANTS, _VOWELS)
    return "".join(map(secrets.choice, letters))


def _ignore(line: str) -> None:
    """With --quiet nothing is said."""


def _needs_key(request: LinkRequest, places: Sequence[Endpoint]) -> bool:
    return not request.insecure and not all(place.is_loopback for place in places)


def _why_open(request: LinkRequest) -> str:
    if request.insecure:
        return "--insecure"
    places = map(parse_endpoint, (*request.listen, *request.connect))
    device = next((place for place in places if place.is_device), None)
    return f"it stays on this {'host' if device is None else f'{device.scheme} line'}"


def _check_open(request: LinkRequest, connect: tuple[str, ...]) -> None:
    """Raise `UserError` if a call that leaves this host has no key."""
    places = tuple(map(parse_remote_endpoint, connect))
    if _needs_key(request, places):
        raise UserError(
            f"no invitation for {places[0].address}: give the line that the other end has printed"
            " (encode and decode --invite LINE, call LINE), or --insecure to go without encryption"
        )


def _check_certificate(request: LinkRequest) -> None:
    """Raise `UserError` if an endpoint asks for a certificate and there is none."""
    for text in (*request.listen, *request.connect):
        if parse_endpoint(text).scheme in CERTIFIED_SCHEMES and request.keys is None:
            raise UserError(
                f"{text}: give --keys with the key file that the relay's owner has made"
            )


def _place(
    invitation: Invitation | None, name: str, is_encoder: bool, wait_s: float, tell: Say
) -> str:
    """Where to connect to if nothing says it: as the invitation says, or as who listens says."""
    if invitation is not None:
        return invitation.address
    tell(f"looking for call {name!r} on the local network")
    found = find_call(name, is_encoder, wait_s)
    if found.needs_invitation:
        raise UserError(
            f"call {name!r} at {found.address} needs an invitation: give --invite with the line"
            " that the other end has printed"
        )
    return found.address


def _given_invitation(request: LinkRequest) -> Invitation | None:
    """The invitation on the command line, or in a file; None if there is none yet."""
    text, path = request.invite, request.invite_file
    if path is not None:
        try:
            text = path.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError as error:
            if request.listen:
                return None
            raise UserError(f"{path}: no such file") from error
        except OSError as error:
            raise UserError(f"cannot read {path}: {error.strerror}") from error
    if text is None:
        return None
    try:
        return parse_invitation(text)
    except ProtocolError as error:
        raise UserError(f"{path or '--invite'}: {error}") from error


def _new_invitation(request: LinkRequest, listen: Sequence[Endpoint], tell: Say) -> Invitation:
    """The invitation of an end that listens, which is told, and written if that was asked for."""
    from protocol.security.private_file import write_private

    # On a loopback address one is made if a file is named for it.
    place = next((place for place in listen if not place.is_loopback), listen[0])
    if not place.port and not place.is_device:
        raise UserError("name a port to listen on: the invitation has to tell it")
    host: str | None
    if place.is_device:
        host = DEVICE_HOST
    elif place.is_any:
        host = address_for_others()
    else:
        host = place.host
    if host is None:
        raise UserError("this host has no address on a network: name one with --listen HOST:PORT")
    invitation = Invitation(
        host, place.port or DEFAULT_PORT, request.call or random_call_name(), random_key()
    )
    own = place.scheme is not None and place.scheme not in DEFAULT_SCHEMES
    where = "DEVICE" if place.is_device else invitation.address
    extra = f" (and --connect {place.scheme}/{where})" if own else ""
    if request.invite_file is not None:
        write_private(request.invite_file, f"{invitation}\n".encode())
        tell(f"the invitation is in {request.invite_file}: send it to the other end{extra}")
    else:
        # Also with --quiet: without it nobody could join.
        say(f"send this invitation to the other end{extra}: {invitation}")
    return invitation


def _key_file(path: Path | None) -> KeyFile | None:
    if path is None:
        return None
    from protocol.security.key_file import read_key_file

    return read_key_file(path)
