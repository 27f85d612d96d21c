"""`risorius keys`, and what `risorius relay` makes of its folder."""

import stat
from pathlib import Path

import pytest
from conftest import Start
from processes import error_line, finish, first_line

from loopback.process_pair import free_port
from protocol.security.key_file import read_key_file
from risorius.cli import main

Capture = pytest.CaptureFixture[str]


def test_peers_are_invited_listed_and_revoked(tmp_path: Path, capsys: Capture) -> None:
    folder, anna = str(tmp_path / "keys"), tmp_path / "anna.keys"
    assert main(["keys", "new", folder, "--host", "relay.example", "--host", "::1"]) == 0
    line = ["keys", "invite", folder, "anna", "--call", "one", "--role", "caller"]
    assert main([*line, "--days", "3", "-o", str(anna)]) == 0
    assert stat.S_IMODE(anna.stat().st_mode) == 0o600
    assert b"PRIVATE KEY" in read_key_file(anna).private_key
    capsys.readouterr()
    assert main(["keys", "list", folder]) == 0
    assert capsys.readouterr().out.split()[:4] == ["anna", "caller", "one", "until"]
    assert main(["keys", "revoke", folder, "anna"]) == 0
    capsys.readouterr()
    assert main(["keys", "list", folder]) == 0
    assert capsys.readouterr().out.split() == ["anna", "caller", "one", "revoked"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("invite {} anna --call one --role viewer", "invited already"),
        ("invite {} relay --call one --role viewer", "peer name"),
        ("invite {} bob --call a/b --role viewer", "call name"),
        ("invite {} bob --call one --role king", "--help"),
        ("invite {} bob --call one --role viewer --days 0", "number of days"),
        ("revoke {} bob", "nobody of the name bob"),
        ("new {} --host relay.example", "choose another folder"),
        ("new {}2 --host two/names", "a name or an address"),
        ("list {}3", "risorius keys new"),
        ("{}", "--help"),
    ],
)
def test_mistakes_are_one_line(line: str, expected: str, tmp_path: Path, capsys: Capture) -> None:
    folder = str(tmp_path / "keys")
    first = ["invite", folder, "anna", "--call", "one", "--role", "caller"]
    assert main(["keys", "new", folder, "--host", "127.0.0.1"]) == 0
    assert main(["keys", *first, "-o", str(tmp_path / "anna.keys")]) == 0
    capsys.readouterr()
    assert main(["keys", *line.format(folder).split()]) == 2
    assert expected in error_line(capsys)


def test_nobody_is_invited_whose_keys_cannot_be_written(tmp_path: Path, capsys: Capture) -> None:
    folder, too_long = str(tmp_path / "keys"), str(tmp_path / ("k" * 250))
    assert main(["keys", "new", folder, "--host", "127.0.0.1"]) == 0
    line = ["keys", "invite", folder, "anna", "--call", "one", "--role", "caller", "-o"]
    assert main([*line, too_long]) == 2
    capsys.readouterr()
    assert main(["keys", "list", folder]) == 0
    assert capsys.readouterr().out == ""
    assert main([*line, str(tmp_path / "anna.keys")]) == 0


@pytest.mark.parametrize("endpoint", [":7447", "tcp/:7447", "udp/127.0.0.1:7447"])
def test_a_relay_with_keys_has_no_way_in_without_certificate(
    endpoint: str, capsys: Capture, tmp_path: Path
) -> None:
    assert main(["relay", "--listen", endpoint, "--keys", str(tmp_path)]) == 2
    assert "tls/HOST:PORT" in error_line(capsys)


def test_a_relay_without_its_keys_does_not_start(tmp_path: Path, capsys: Capture) -> None:
    assert main(["relay", "--listen", "tls/127.0.0.1:1", "--keys", str(tmp_path)]) == 2
    assert "risorius keys new" in error_line(capsys)
    assert main(["relay", "--listen", "tcp/127.0.0.1:1", "--max-peers", "1"]) == 2
    assert "at least 2" in error_line(capsys)


def test_a_running_relay_takes_up_changed_keys(tmp_path: Path, start: Start) -> None:
    folder, place = str(tmp_path / "keys"), f"tls/127.0.0.1:{free_port()}"
    assert main(["keys", "new", folder, "--host", "127.0.0.1"]) == 0
    relay = start("relay", "--listen", place, "--keys", folder)
    assert first_line(relay) == f"relay: listening on {place}"
    output = str(tmp_path / "a.keys")
    line = ["keys", "invite", folder, "a", "--call", "one", "--role", "caller", "-o", output]
    assert main(line) == 0
    assert first_line(relay) == "relay: the keys have changed"
    relay.terminate()
    assert finish(relay) == (0, "")


def test_an_invitation_to_a_relay_with_certificates_says_how_it_is_reached(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["invite", "tls/relay.example:7461", "--call", "anna"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("risorius://relay.example:7461/anna#")
    assert "--connect tls/relay.example:7461" in printed.err
    assert main(["invite", "relay.example:7461", "--call", "anna"]) == 0
    assert not capsys.readouterr().err


def test_who_was_revoked_before_is_not_revoked_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "keys")
    invite = ["invite", folder, "bob", "--call", "a", "--role", "viewer", "-o", folder + ".bob"]
    for line in (["new", folder, "--host", "localhost"], invite, ["revoke", folder, "bob"]):
        assert main(["keys", *line]) == 0
    assert "bob is revoked" in capsys.readouterr().out
    assert main(["keys", "revoke", folder, "bob"]) == 0
    assert capsys.readouterr().out == "bob was revoked before\n"
