"""Where a call is, from the arguments of the command line."""

import pytest

from protocol.link.interface import LinkOptions
from protocol.security.invitation import Invitation, parse_invitation
from risorius.cli import build_parser
from risorius.live_call.call_place import own_address, read_place
from shared_model.errors import UserError

INVITATION = Invitation("192.0.2.7", 7447, "anna", bytes(range(16)))


def place(*arguments: str) -> tuple[LinkOptions, str | None]:
    return read_place(build_parser().parse_args(["call", *arguments]))


@pytest.mark.parametrize(
    ("listen", "own"),
    [
        (":7447", "127.0.0.1:7447"),
        ("udp/0.0.0.0:9", "udp/127.0.0.1:9"),
        ("[::]:9", "[::1]:9"),
        ("192.0.2.7:9", "192.0.2.7:9"),
    ],
)
def test_an_end_that_listens_reaches_itself(listen: str, own: str) -> None:
    assert own_address(listen) == own


def test_an_invitation_says_where_with_what_name_and_key() -> None:
    link, handed = place(str(INVITATION))
    assert (link.listen, link.connect, link.call) == ((), ("192.0.2.7:7447",), "anna")
    assert link.security.key == INVITATION.key and handed is None


def test_who_listens_for_others_draws_a_key_and_hands_over_an_invitation() -> None:
    link, line = place("--listen", "192.0.2.7:7447", "--call", "anna")
    assert line is not None
    handed = parse_invitation(line)
    assert handed.key == link.security.key and handed.address == "192.0.2.7:7447"
    assert handed.call == link.call == "anna"


def test_without_encryption_only_on_this_host_or_if_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert place("127.0.0.1:7447")[0].security.key is None
    assert place("192.0.2.7:7447", "--insecure")[0].security.key is None
    with pytest.raises(UserError, match="no invitation"):
        place("192.0.2.7:7447")
    _, handed = place("--listen", "192.0.2.7:7447", "--insecure")
    assert handed == "risorius call 192.0.2.7:7447 --call call --insecure"
    assert handed in capsys.readouterr().err
