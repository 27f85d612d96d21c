"""`risorius keys`: who may use a relay; `risorius invite`: an invitation to a call at a relay."""

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.argument_types import days
from risorius.command_line.parser import add_command
from risorius.command_line.progress import say

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

ROLES = ("caller", "viewer")


def add_keys(added: "Commands") -> None:
    """`risorius keys`."""
    parser = add_command(
        added,
        "keys",
        "make and revoke the certificates of a relay's peers",
        "A folder holds a private authority.  Each peer gets a key file for one call and one\n"
        "role: a caller sends the face, a viewer watches it.  The relay refuses everybody else,\n"
        "and who was revoked within a second.",
        "  risorius keys new relay-keys --host relay.example --host 192.0.2.7\n"
        "  risorius keys invite relay-keys anna --call anna --role caller -o anna.keys\n"
        "  risorius keys invite relay-keys bob --call anna --role viewer -o bob.keys\n"
        "  risorius keys list relay-keys\n"
        "  risorius keys revoke relay-keys bob\n"
        "  risorius relay --listen tls/:7447 --keys relay-keys\n",
    )
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    new = actions.add_parser("new", help="make an authority and the relay's own keys")
    _add_folder(new)
    new.add_argument(
        "--host",
        action="append",
        required=True,
        help="name or address under which peers reach the relay; may be given several times",
    )
    new.set_defaults(run=_new)
    _add_peer(actions)
    listing = actions.add_parser("list", help="show who was invited")
    _add_folder(listing)
    listing.set_defaults(run=_list)
    revoke = actions.add_parser("revoke", help="let the relay refuse a peer")
    _add_folder(revoke)
    revoke.add_argument("name", metavar="NAME", help="the peer")
    revoke.set_defaults(run=_revoke)


def add_invite(added: "Commands") -> None:
    """`risorius invite`."""
    parser = add_command(
        added,
        "invite",
        "draw a key for a call at a relay and print the invitation",
        "Both ends of the call get the line; the relay does not, and can neither watch nor forge.\n"
        "Who listens without a relay prints an invitation by itself.",
        "  risorius invite relay.example:7447 --call anna\n"
        "  risorius invite tls/relay.example:7447 --call anna -o anna.invite\n",
    )
    parser.add_argument("relay", metavar="HOST:PORT", help="where the relay listens")
    parser.add_argument("--call", metavar="NAME", help="name of the call (default: one is drawn)")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="write the line into a file that only you can read, instead of printing it",
    )
    parser.set_defaults(run=_draw)


def _add_peer(actions: "Commands") -> None:
    invite = actions.add_parser("invite", help="make the key file of a peer")
    _add_folder(invite)
    invite.add_argument("name", metavar="NAME", help="name of the peer, in its certificate")
    invite.add_argument("--call", required=True, metavar="CALL", help="the call it takes part in")
    invite.add_argument("--role", choices=ROLES, required=True, help="what it may do there")
    invite.add_argument(
        "--days", type=days, default=365, metavar="N", help="valid so long (default: %(default)s)"
    )
    invite.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="key file to write (default: NAME.keys)"
    )
    invite.set_defaults(run=_invite)


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the folder of the authority")


def _now() -> datetime:
    return datetime.now(UTC)


def _new(arguments: argparse.Namespace) -> int:
    from protocol.security.authority import create_authority

    create_authority(arguments.folder, arguments.host, _now())
    print(f"{arguments.folder}: an authority for {', '.join(arguments.host)}; keep it secret")
    return 0


def _invite(arguments: argparse.Namespace) -> int:
    from protocol.security.authority import PeerRole, invite_peer
    from protocol.security.private_file import write_private
    from risorius.command_line.output_checks import check_outputs

    output: Path = arguments.output or Path(f"{arguments.name}.keys")
    check_outputs([], [output])
    role = PeerRole(arguments.role)
    whom = arguments.name, arguments.call, role
    invite_peer(
        arguments.folder, *whom, _now(), arguments.days, lambda keys: write_private(output, keys)
    )
    print(f"{output}: keys of {arguments.name}, {role} of call {arguments.call!r}")
    return 0


def _list(arguments: argparse.Namespace) -> int:
    from protocol.security.authority import read_peers

    for peer in read_peers(arguments.folder):
        state = "revoked" if peer.revoked else f"until {peer.expires}"
        print(f"{peer.name:20} {peer.role:7} {peer.call:20} {state}")
    return 0


def _revoke(arguments: argparse.Namespace) -> int:
    from protocol.security.authority import read_peers, revoke_peer

    revoked = [peer.name for peer in read_peers(arguments.folder) if peer.revoked]
    if arguments.name in revoked:
        print(f"{arguments.name} was revoked before")
        return 0
    revoke_peer(arguments.folder, arguments.name)
    print(f"{arguments.name} is revoked; a relay that runs with {arguments.folder} refuses it")
    return 0


def _draw(arguments: argparse.Namespace) -> int:
    from protocol.endpoint import DEFAULT_SCHEMES, parse_remote_endpoint
    from protocol.security.invitation import Invitation, random_key
    from protocol.security.private_file import write_private
    from risorius.command_line.call_link import check_call_name, random_call_name

    endpoint = parse_remote_endpoint(arguments.relay)
    check_call_name(arguments.call)
    name = arguments.call or random_call_name()
    invitation = Invitation(endpoint.host, endpoint.port, name, random_key())
    if arguments.output is None:
        print(invitation)
    else:
        write_private(arguments.output, f"{invitation}\n".encode())
    if endpoint.scheme is not None and endpoint.scheme not in DEFAULT_SCHEMES:
        say(f"with the invitation both ends give --connect {endpoint.scheme}/{invitation.address}")
    return 0
