"""The keys of a call, and what is said on them."""

from hypothesis import given
from hypothesis import strategies as st

from protocol.link.messages import Role
from protocol.link.presence import (
    MAX_PRESENCE_BYTES,
    call_keys,
    parse_presence,
    serialise_presence,
)
from protocol.relay.access import access_control
from protocol.security.authority import InvitedPeer, PeerRole

ANNA = InvitedPeer("anna", "one", PeerRole.CALLER, "1", "2030-01-01")


def test_an_end_publishes_what_the_other_subscribes_to() -> None:
    assert call_keys("anna", is_encoder=True) == call_keys("anna", is_encoder=False)[::-1]


def test_who_asks_and_answers_is_said() -> None:
    for role, call in ((Role.ENCODER, "anna"), (Role.DECODER, "a.b"), (Role.RELAY, "")):
        assert parse_presence(serialise_presence(role, call)) == (role, call)
    for wrong in (
        b"",
        b"\x07anna",
        b"\x00",
        b"\x02anna",
        b"\x00a/b",
        bytes(MAX_PRESENCE_BYTES + 1),
    ):
        assert parse_presence(wrong) is None


@given(st.binary(max_size=64))
def test_any_bytes_say_who_is_there_or_not(data: bytes) -> None:
    found = parse_presence(data)
    assert found is None or serialise_presence(*found) == data


def test_rules_name_every_peer_once_and_no_revoked_one() -> None:
    again = InvitedPeer("gone", "one", PeerRole.VIEWER, "2", "2030-01-01", revoked=True)
    settings = access_control([ANNA, again])
    assert settings["default_permission"] == "deny"
    assert [subject["id"] for subject in settings["subjects"]] == ["anna", "relay"]
    identities = [rule["id"] for rule in settings["rules"]]
    assert len(identities) == len(set(identities))
