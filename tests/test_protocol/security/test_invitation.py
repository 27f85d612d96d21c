"""Invitations: what is handed over comes back, and what was copied wrongly is refused."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.limits import DEFAULT_PORT
from protocol.security.invitation import (
    KEY_BYTES,
    MAX_INVITATION_CHARACTERS,
    Invitation,
    format_key,
    parse_invitation,
    parse_key,
    random_key,
)

KEY = bytes(range(1, 17))
KEY_TEXT = "0410-6105-0R3G-G28A-1C60-T3GF-20DA"
keys = st.binary(min_size=KEY_BYTES, max_size=KEY_BYTES)
ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"


def test_a_key_is_written_as_it_always_was() -> None:
    assert format_key(KEY) == KEY_TEXT
    assert parse_key(KEY_TEXT) == KEY


@given(keys)
def test_keys_come_back(key: bytes) -> None:
    text = format_key(key)
    assert parse_key(text) == key
    assert [len(group) for group in text.split("-")] == [4] * 7
    assert set(text) <= {*ALPHABET, "-"}


def test_keys_differ_and_have_all_their_bits() -> None:
    made = {random_key() for _ in range(100)}
    assert len(made) == 100
    assert {len(key) for key in made} == {KEY_BYTES}


@given(keys)
def test_a_key_may_be_read_out_and_typed_in(key: bytes) -> None:
    """In lower case, without dashes or with others, letters for the digits they look like."""
    text = format_key(key)
    for typed in (
        text.lower(),
        text.replace("-", ""),
        "-".join(text.replace("-", "")),
        text.replace("0", "O").replace("1", "l"),
        text.replace("0", "o").replace("1", "I"),
    ):
        assert parse_key(typed) == key


# Each key has 868 wrong ones.
@settings(max_examples=20)
@given(keys)
def test_every_wrong_character_is_noticed(key: bytes) -> None:
    text = format_key(key).replace("-", "")
    for place, right in enumerate(text):
        for wrong in ALPHABET:
            if wrong != right:
                with pytest.raises(ProtocolError, match="copied wrongly"):
                    parse_key(text[:place] + wrong + text[place + 1 :])


@given(keys)
def test_every_two_characters_that_changed_places_are_noticed(key: bytes) -> None:
    text = format_key(key).replace("-", "")
    for place in range(len(text) - 1):
        first, second = text[place], text[place + 1]
        if first != second:
            with pytest.raises(ProtocolError, match="copied wrongly"):
                parse_key(text[:place] + second + first + text[place + 2 :])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "0 characters, expected 28"),
        (KEY_TEXT[:-1], "27 characters"),
        (KEY_TEXT + "0", "29 characters"),
        (KEY_TEXT[:-1] + "U", "has a 'U', which none has"),
        (KEY_TEXT[:-1] + "ß", "29 characters"),
        (KEY_TEXT[:-1] + " ", "has a ' '"),
    ],
)
def test_what_cannot_be_a_key_is_refused(text: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse_key(text)


@pytest.mark.parametrize(
    ("text", "host", "port", "call"),
    [
        ("risorius://192.0.2.7:7447/anna#", "192.0.2.7", 7447, "anna"),
        ("risorius://192.0.2.7/anna#", "192.0.2.7", DEFAULT_PORT, "anna"),
        ("RISORIUS://host.example:1/a.b-c_d#", "host.example", 1, "a.b-c_d"),
        ("risorius://[2001:db8::7]:65535/x#", "2001:db8::7", 65535, "x"),
        ("risorius://[::1]/x#", "::1", DEFAULT_PORT, "x"),
        ("risorius://bücher.example/x#", "bücher.example", DEFAULT_PORT, "x"),
    ],
)
def test_invitations_are_read(text: str, host: str, port: int, call: str) -> None:
    for line in (text + KEY_TEXT, f"  {text}{KEY_TEXT.lower()}\n"):
        assert parse_invitation(line) == Invitation(host, port, call, KEY)


@given(
    st.sampled_from(["192.0.2.7", "host", "a-b.example", "2001:db8::1", "::"]),
    st.integers(1, 65535),
    st.from_regex(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,39}", fullmatch=True),
    keys,
)
def test_invitations_come_back(host: str, port: int, call: str, key: bytes) -> None:
    invitation = Invitation(host, port, call, key)
    assert parse_invitation(str(invitation)) == invitation


def test_addresses_are_as_endpoints_have_them() -> None:
    assert Invitation("host", 1, "x", KEY).address == "host:1"
    assert Invitation("::1", 1, "x", KEY).address == "[::1]:1"


@pytest.mark.parametrize(
    "line",
    [
        "",
        "anna",
        "https://192.0.2.7:7447/anna#" + KEY_TEXT,
        "risorius://192.0.2.7:7447/anna",
        "risorius://192.0.2.7:7447/#" + KEY_TEXT,
        "risorius:///anna#" + KEY_TEXT,
        "risorius://:7447/anna#" + KEY_TEXT,
        "risorius://user@host/anna#" + KEY_TEXT,
        "risorius://host:port/anna#" + KEY_TEXT,
        "risorius://[::1/anna#" + KEY_TEXT,
        "risorius://host/an na#" + KEY_TEXT,
        "risorius://host/an/na#" + KEY_TEXT,
        f"risorius://host/anna#{KEY_TEXT}\nrisorius://host/anna#{KEY_TEXT}",
    ],
)
def test_what_is_no_invitation_is_refused_with_what_one_is(line: str) -> None:
    with pytest.raises(ProtocolError, match="expected risorius://HOST:PORT/CALL#KEY"):
        parse_invitation(line)


@pytest.mark.parametrize("port", [0, 65536, 99999])
def test_ports_that_are_none_are_refused(port: int) -> None:
    with pytest.raises(ProtocolError, match=f"port is {port}"):
        parse_invitation(f"risorius://host:{port}/anna#{KEY_TEXT}")


def test_an_endless_line_is_not_looked_at() -> None:
    with pytest.raises(ProtocolError, match=f"at most {MAX_INVITATION_CHARACTERS} characters"):
        parse_invitation("risorius://" + "a" * MAX_INVITATION_CHARACTERS)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"host": "a b"}, "host is 'a b'"),
        ({"host": ""}, "host is ''"),
        ({"port": 0}, "port is 0"),
        ({"call": "a/b"}, "call is 'a/b'"),
        ({"key": b"short"}, "key has 5 bytes, expected 16"),
    ],
)
def test_fields_that_cannot_be_are_refused(wrong: dict[str, object], message: str) -> None:
    right = {"host": "host", "port": 1, "call": "anna", "key": KEY}
    with pytest.raises(ValueError, match=message):
        Invitation(**(right | wrong))  # type: ignore[arg-type]


def test_neither_messages_nor_representations_tell_the_key() -> None:
    secret = KEY_TEXT.replace("-", "")
    wrong = "risorius://host:0/anna#" + secret[:-1] + ("0" if secret[-1] != "0" else "2")
    with pytest.raises(ProtocolError) as refused:
        parse_invitation(wrong)
    assert secret[:8] not in str(refused.value)
    assert repr(Invitation("host", 1, "anna", KEY)) == (
        "Invitation(host='host', port=1, call='anna')"
    )


@given(st.text(max_size=80))
def test_garbage_is_refused(text: str) -> None:
    with pytest.raises(ProtocolError):
        parse_invitation(text)
