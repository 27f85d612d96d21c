"""SFrame: the RFC's example, and what a receiver must refuse."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.security.sframe import (
    COUNTER_LIMIT,
    KEY_ID_LIMIT,
    MAX_AHEAD,
    REPLAY_WINDOW,
    SESSION_KEY_IDS,
    TAG_BYTES,
    Key,
    ReplayWindow,
    derive_base_key,
    derive_key,
    derive_session_key,
    parse_header,
    protect,
    random_session,
    serialise_header,
    unprotect,
)

BASE_KEY = bytes(range(16))
INVITATION_KEY = bytes(range(16, 32))
numbers = st.one_of(st.integers(0, 300), st.integers(0, KEY_ID_LIMIT - 1))


@pytest.fixture
def key() -> Key:
    return derive_key(BASE_KEY, 5)


def test_the_example_of_the_rfc() -> None:
    """RFC 9605, appendix C.3, cipher suite 3."""
    key = derive_key(BASE_KEY, 0x123)
    packet = protect(key, 0x4567, b"draft-ietf-sframe-enc", b"IETF SFrame WG")
    assert key.cipher.hex() == "2c5703089cbb8c583475e4fc461d97d1"
    assert key.authentication.hex() == (
        "8809df79b6d550f78eb6d50ffa80d89211d57909934f46f5405e38cd583c69fe"
    )
    assert key.salt.hex() == "38c16e4f5159700c00c7f350"
    assert packet.hex() == "990123456717fc8af28a5a695afcfc6c8df6358a17e26b2fcb3bae32e443"
    assert unprotect(key, packet, b"IETF SFrame WG") == (0x4567, b"draft-ietf-sframe-enc")


def test_keys_of_a_call_stay_as_they_are() -> None:
    base = derive_base_key(INVITATION_KEY, "encoder", "anna")
    assert base.hex() == "b784494472c6c5a2bec8124bd3f6b678"
    assert (
        protect(derive_session_key(base, 1 << 63), 300, b"a frame").hex()
        == "29012c46a5305d33c0c014f1235e"
    )


@pytest.mark.parametrize(
    ("key_id", "counter", "header"),
    [
        (0, 0, "00"),
        (7, 7, "77"),
        (7, 8, "7808"),
        (8, 7, "8708"),
        (5, 255, "58ff"),
        (5, 256, "590100"),
        (0x123, 0x4567, "9901234567"),
        (KEY_ID_LIMIT - 1, COUNTER_LIMIT - 1, "ff" + 16 * "ff"),
    ],
)
def test_headers_are_as_short_as_can_be(key_id: int, counter: int, header: str) -> None:
    assert serialise_header(key_id, counter).hex() == header


@given(numbers, numbers, st.binary(max_size=4))
def test_headers_come_back(key_id: int, counter: int, rest: bytes) -> None:
    header = serialise_header(key_id, counter)
    assert parse_header(header + rest) == (key_id, counter, len(header))


@given(st.binary(max_size=20))
def test_a_header_has_one_encoding(data: bytes) -> None:
    try:
        key_id, counter, length = parse_header(data)
    except ProtocolError:
        return
    assert serialise_header(key_id, counter) == data[:length]


@given(numbers, numbers, st.binary(max_size=200), st.binary(max_size=20))
def test_packets_come_back(key_id: int, counter: int, plaintext: bytes, metadata: bytes) -> None:
    key = derive_key(BASE_KEY, key_id)
    packet = protect(key, counter, plaintext, metadata)
    assert len(packet) == len(serialise_header(key_id, counter)) + len(plaintext) + TAG_BYTES
    assert unprotect(key, packet, metadata) == (counter, plaintext)


@pytest.mark.parametrize("size", [0, 1, 25])
@pytest.mark.parametrize("counter", [0, 9, 300])
def test_every_changed_bit_is_noticed(key: Key, size: int, counter: int) -> None:
    packet = protect(key, counter, bytes(size), b"call")
    for bit in range(8 * len(packet)):
        changed = bytearray(packet)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ProtocolError):
            unprotect(key, bytes(changed), b"call")


def test_every_truncation_and_every_longer_packet_is_noticed(key: Key) -> None:
    packet = protect(key, 300, b"a frame")
    for wrong in [*(packet[:length] for length in range(len(packet))), packet + b"\0"]:
        with pytest.raises(ProtocolError):
            unprotect(key, wrong)


def test_other_metadata_or_another_key_is_noticed(key: Key) -> None:
    packet = protect(key, 1, b"a frame", b"call")
    with pytest.raises(ProtocolError, match="tag"):
        unprotect(key, packet, b"another call")
    with pytest.raises(ProtocolError, match="tag"):
        unprotect(derive_key(bytes(16), 5), packet, b"call")
    with pytest.raises(ProtocolError, match="key ID 5, expected 6"):
        unprotect(derive_key(BASE_KEY, 6), packet, b"call")


@given(st.binary(max_size=60))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        unprotect(derive_key(BASE_KEY, 0), data)


def test_nobody_can_send_beyond_the_last_counter_or_key_id(key: Key) -> None:
    for counter in (-1, COUNTER_LIMIT):
        with pytest.raises(ValueError, match="counter"):
            protect(key, counter, b"")
    for key_id in (-1, KEY_ID_LIMIT):
        with pytest.raises(ValueError, match="key ID"):
            derive_key(BASE_KEY, key_id)


def test_ends_calls_and_sessions_have_keys_of_their_own() -> None:
    bases = [
        derive_base_key(key, sender, call)
        for key in (INVITATION_KEY, BASE_KEY)
        for sender in ("encoder", "decoder")
        for call in ("anna", "berta")
    ]
    keys = [derive_session_key(base, session) for base in bases for session in (8, 16, 9)]
    introducing = [derive_key(base, 0) for base in bases]
    assert len({key.cipher for key in keys + introducing}) == 4 * len(bases)
    assert {key.key_id for key in keys} <= set(SESSION_KEY_IDS)


def test_sessions_are_numbers_of_64_bits_that_differ() -> None:
    sessions = [random_session() for _ in range(1000)]
    assert len(set(sessions)) == 1000
    assert all(0 <= session < COUNTER_LIMIT for session in sessions)
    assert min(sessions) < COUNTER_LIMIT // 16 < COUNTER_LIMIT // 16 * 15 < max(sessions)


def test_secrets_are_not_printed(key: Key) -> None:
    assert repr(key) == "Key(key_id=5)"


def test_a_window_takes_what_is_late_but_not_what_is_too_old_or_too_far_ahead() -> None:
    window = ReplayWindow()
    assert window.take(5000) and window.take(5001 - REPLAY_WINDOW)
    assert not window.take(5001 - REPLAY_WINDOW)
    assert not window.take(5000 - REPLAY_WINDOW)
    assert not window.take(5001 + MAX_AHEAD)
    assert window.newest == 5000
    assert window.take(5000 + MAX_AHEAD)
    assert not window.take(5001)
    assert window.take(5000 + MAX_AHEAD - 1)


def test_a_window_that_begins_later_takes_nothing_before() -> None:
    window = ReplayWindow(10)
    assert [window.take(counter) for counter in (3, 10, 11, 12, 11)] == [
        False,
        False,
        True,
        True,
        False,
    ]


@given(st.lists(st.integers(0, 3 * REPLAY_WINDOW), max_size=60))
def test_no_counter_is_taken_twice(counters: list[int]) -> None:
    window, taken, newest = ReplayWindow(), set[int](), -1
    for counter in counters:
        new = counter not in taken and counter > newest - REPLAY_WINDOW
        assert window.can_take(counter) == window.take(counter) == new
        if new:
            taken.add(counter)
            newest = max(newest, counter)
