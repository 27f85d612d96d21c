"""Options of a link: who gets an invitation, who needs one, and what is said."""

import argparse
import socket
import stat
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from processes import one_line

from protocol.endpoint import DEVICE_SCHEMES
from protocol.link.carriers import DEVICE_CARRIERS
from protocol.link.interface import LinkOptions
from protocol.security.invitation import Invitation, parse_invitation
from risorius.cli import main
from risorius.command_line.call_link import (
    add_link,
    check_place,
    link_request,
    read_link,
)
from shared_model.errors import UserError

# Of hosts that are in no network (RFC 5737).
OTHER, OWN = "192.0.2.7:7447", "192.0.2.8:7447"
INVITATION = Invitation("192.0.2.7", 7447, "anna", bytes(range(16)))

Capture = pytest.CaptureFixture[str]


def link_of(*arguments: str) -> LinkOptions:
    """What a decoder makes of its arguments."""
    parser = argparse.ArgumentParser()
    add_link(parser, parser.add_mutually_exclusive_group())
    parser.add_argument("--quiet", action="store_true")
    parsed = parser.parse_args(arguments)
    check_place(parsed, "a call file", False)
    return read_link(link_request(parsed), is_encoder=False, wait_s=0.1)


def refusal(*arguments: str) -> str:
    with pytest.raises(UserError) as caught:
        link_of(*arguments)
    return str(caught.value)


@pytest.mark.parametrize("quiet", [[], ["--quiet"]])
def test_who_listens_beyond_this_host_prints_one_line_to_send(
    quiet: Sequence[str], capsys: Capture
) -> None:
    link = link_of("--listen", OWN, "--call", "anna", *quiet)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("send this invitation to the other end: ")
    invitation = parse_invitation(line.rpartition(" ")[2])
    assert (invitation.address, invitation.call) == (OWN, "anna")
    assert link.security.key == invitation.key and link.call == "anna"
    other = link_of("--invite", str(invitation), *quiet)
    assert capsys.readouterr().err == ""
    assert (other.call, other.listen, other.connect) == ("anna", (), (OWN,))
    assert other.security == link.security
    assert repr(other).find(str(invitation.key)) < 0


def test_each_start_draws_a_new_key(capsys: Capture) -> None:
    links = [link_of("--listen", OWN) for _ in range(2)]
    assert links[0].security.key != links[1].security.key
    assert links[0].call != "call", "a call without a name gets one"


def test_a_file_keeps_the_invitation_out_of_the_list_of_processes(
    tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "anna.invite"
    first = link_of("--listen", OWN, "--call", "anna", "--invite-file", str(path))
    assert str(path) in capsys.readouterr().err
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert link_of("--invite-file", str(path)).security == first.security
    # Who listens again keeps the key, so that the other end need not be told again.
    assert link_of("--listen", OWN, "--invite-file", str(path)).security == first.security
    assert capsys.readouterr().err == ""


def test_an_invitation_goes_with_a_place_of_its_own() -> None:
    link = link_of("--connect", "tcp/relay.example:7447", "--invite", str(INVITATION))
    assert link.connect == ("tcp/relay.example:7447",)
    assert link.security.key == INVITATION.key and link.call == "anna"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--listen", "127.0.0.1:7447"), "it stays on this host"),
        (("--connect", "localhost:7447"), "it stays on this host"),
        (("--listen", "[::1]:7447"), "it stays on this host"),
        (("--listen", OWN, "--insecure"), "--insecure"),
        (("--connect", OTHER, "--insecure"), "--insecure"),
    ],
)
def test_only_loopback_and_insecure_go_without_and_say_so_once(
    arguments: Sequence[str], reason: str, capsys: Capture
) -> None:
    link = link_of(*arguments)
    assert link.security.key is None and link.call == "call"
    assert capsys.readouterr().err == f"this call is not encrypted: {reason}\n"
    assert link_of(*arguments, "--quiet") == link
    assert capsys.readouterr().err == ""


def test_a_device_gets_an_invitation_too(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "invitation"
    link = link_of("--listen", "serial//dev/ttyS0", "--invite-file", str(path))
    assert "(and --connect serial/DEVICE)" in capsys.readouterr().err
    other = link_of("--connect", "serial//dev/ttyS1", "--invite-file", str(path))
    assert other.security.key == link.security.key and other.call == link.call


def test_each_device_has_a_carrier() -> None:
    assert set(DEVICE_CARRIERS) == set(DEVICE_SCHEMES)


def test_a_file_that_is_named_for_the_invitation_gets_one_on_this_host_too(
    tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "invitation"
    link = link_of("--listen", "127.0.0.1:7447", "--invite-file", str(path))
    assert capsys.readouterr().err.startswith(f"the invitation is in {path}")
    invitation = parse_invitation(path.read_text())
    assert invitation.address == "127.0.0.1:7447" and invitation.key == link.security.key
    assert link_of("--invite-file", str(path)).security == link.security


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--connect", OTHER), "no invitation for 192.0.2.7:7447"),
        (("--connect", "127.0.0.1:1", "--connect", OTHER), "--insecure"),
        (("--listen", "192.0.2.8:0"), "name a port"),
        (("--invite", "risorius://192.0.2.7/anna"), "--invite: no invitation"),
        (("--invite", f"{str(INVITATION)[:-1]}0"), "copied wrongly"),
        (("--invite", str(INVITATION), "--call", "bert"), "to call 'anna'"),
        (("--connect", "127.0.0.1:1", "--call", "a/b"), "call name"),
        (("--connect", "tls/127.0.0.1:1"), "tls/127.0.0.1:1: give --keys"),
        (("--listen", "quic/127.0.0.1:1"), "give --keys"),
        (("--connect", "127.0.0.1:1", "--keys", "/nowhere"), "cannot read /nowhere"),
        (("--invite-file", "/nowhere"), "/nowhere: no such file"),
        (("--invite-file", "/"), "cannot read /"),
        ((), "see --help"),
    ],
)
def test_what_is_missing_or_does_not_go_together_is_said(
    arguments: Sequence[str], expected: str
) -> None:
    assert expected in refusal(*arguments)


def test_a_line_of_an_invitation_is_not_repeated_in_an_error() -> None:
    wrong = str(INVITATION).replace("anna", "an na")
    assert str(INVITATION)[-20:] not in refusal("--invite", wrong)


@pytest.mark.parametrize(
    "options", ["--call anna", "--invite {}", "--insecure", "--invite-file x", "--keys x"]
)
def test_a_call_file_takes_no_option_of_a_link(options: str, capsys: Capture) -> None:
    given = options.format(INVITATION).split()
    assert main(["decode", "call.rzo", *given]) == 2
    assert f"leave out {given[0]}" in capsys.readouterr().err


def test_an_invitation_to_a_relay_is_drawn(tmp_path: Path, capsys: Capture) -> None:
    assert main(["invite", "tls/relay.example:7447", "--call", "anna"]) == 0
    invitation = parse_invitation(capsys.readouterr().out)
    assert (invitation.address, invitation.call) == ("relay.example:7447", "anna")
    path = tmp_path / "anna.invite"
    assert main(["invite", "relay.example", "-o", str(path)]) == 0
    assert capsys.readouterr().out == ""
    assert parse_invitation(path.read_text()).address == "relay.example:7447"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert main(["invite", "relay.example", "--call", "a/b"]) == 2


@pytest.mark.parametrize(
    ("line", "code", "reason"),
    [
        ("decode --listen 203.0.113.9:7447", 4, "this host has no such address"),
        ("decode --listen tls/:0", 2, "give --keys"),
        ("decode --listen :0 --view --port {busy}", 4, "the port is in use; try another --port"),
        ("encode me.mp4 --listen :{busy}", 4, "the port is in use"),
        ("call --listen :{busy}", 4, "the port is in use"),
        ("call --listen :9 --port {busy}", 4, "the port is in use; try another --port"),
        ("call --listen :9 --camera none.mp4", 2, "cannot read none.mp4: no such file"),
        ("call --listen :9 --camera {text}", 2, "is not a video that can be read"),
    ],
)
def test_nothing_is_handed_over_before_it_is_checked(
    line: str, code: int, reason: str, tmp_path: Path, capsys: Capture
) -> None:
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        given = line.format(busy=holder.getsockname()[1], text=text)
        assert main(given.split()) == code
    (complaint,) = capsys.readouterr().err.splitlines()
    assert reason in complaint


def test_a_program_ends_with_its_own_exit_code_while_a_link_is_still_being_opened() -> None:
    program = (
        "import socket, sys, time\n"
        "class Slow:\n"
        "    def __del__(self, sleep=time.sleep): sleep(6)\n"
        # What makes the end of the interpreter last longer than opening a connection may.
        "sys.modules['slow'] = Slow()\n"
        "from risorius.cli import main\n"
        "sys.exit(main())"
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        place = f"udp/127.0.0.1:{silent.getsockname()[1]}"
        command = ["decode", "--connect", place, "--timeout", "0.1", "--insecure"]
        process = subprocess.run(
            [sys.executable, "-c", program, *command], capture_output=True, text=True, check=False
        )
    last = process.stderr.splitlines()[-1]
    assert (process.returncode, one_line(last)) == (
        4,
        f"risorius: cannot reach {place} within 0.1 s: no answer",
    )
