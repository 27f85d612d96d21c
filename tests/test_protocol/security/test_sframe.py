"""SFrame: the RFC's example, and what a receiver must refuse."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.security.sframe import (
    COUNTER_LIMIT,
    KEY_ID_LIMIT,
    MAX_KEYS,
    REPLAY_WINDOW,
    TAG_BYTES,
    Key,
    Protector,
    ReplayWindow,
    Unprotector,
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
        == "09012cd199eea10e34cad716edf5"
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
    receiver = Unprotector()
    receiver.add(derive_key(BASE_KEY, 0))
    with pytest.raises(ProtocolError):
        receiver.unprotect(data)


def test_nobody_can_send_beyond_the_last_counter_or_key_id(key: Key) -> None:
    for counter in (-1, COUNTER_LIMIT):
        with pytest.raises(ValueError, match="counter"):
            protect(key, counter, b"")
    for key_id in (-1, KEY_ID_LIMIT):
        with pytest.raises(ValueError, match="key ID"):
            derive_key(BASE_KEY, key_id)


def test_each_packet_of_a_sender_has_its_own_counter(key: Key) -> None:
    sender = Protector(key)
    packets = [sender.protect(b"the same", b"call") for _ in range(20)]
    assert [unprotect(key, packet, b"call") for packet in packets] == [
        (number, b"the same") for number in range(20)
    ]
    assert len({packet[-TAG_BYTES:] for packet in packets}) == 20


def test_ends_calls_and_sessions_have_keys_of_their_own() -> None:
    bases = [
        derive_base_key(key, sender, call)
        for key in (INVITATION_KEY, BASE_KEY)
        for sender in ("encoder", "decoder")
        for call in ("anna", "berta")
    ]
    keys = [derive_session_key(base, session) for base in bases for session in (8, 16, 9)]
    announcing = [derive_key(base, session) for base in bases for session in (8, 16, 9)]
    assert len({key.cipher for key in keys + announcing}) == 2 * len(bases) * 3
    assert all(key.key_id < 8 for key in keys)


def test_sessions_are_numbers_of_eight_bytes_that_differ() -> None:
    sessions = [random_session() for _ in range(1000)]
    assert len(set(sessions)) == 1000
    assert {len(serialise_header(session, 0)) for session in sessions} == {9}


def test_secrets_are_not_printed(key: Key) -> None:
    assert repr(key) == "Key(key_id=5)"


def test_a_packet_is_taken_once(key: Key) -> None:
    sender, receiver = Protector(key), Unprotector()
    receiver.add(key)
    packets = [sender.protect(bytes([number])) for number in range(4)]
    for number in (0, 2, 1, 3):
        assert receiver.unprotect(packets[number]) == (5, bytes([number]))
    for packet in packets:
        with pytest.raises(ProtocolError, match="came before"):
            receiver.unprotect(packet)


def test_a_forged_packet_does_not_move_the_window(key: Key) -> None:
    receiver = Unprotector()
    receiver.add(key)
    forged = bytearray(protect(key, 1 << 40, b"a frame"))
    forged[-1] ^= 1
    with pytest.raises(ProtocolError, match="tag"):
        receiver.unprotect(bytes(forged))
    assert receiver.unprotect(protect(key, 0, b"a frame")) == (5, b"a frame")


def test_a_key_that_is_added_again_keeps_its_window_and_another_replaces_it(key: Key) -> None:
    receiver, packet = Unprotector(), protect(key, 0, b"a frame")
    receiver.add(key)
    receiver.unprotect(packet)
    receiver.add(key)
    with pytest.raises(ProtocolError, match="came before"):
        receiver.unprotect(packet)
    other = derive_key(bytes(16), 5)
    receiver.add(other)
    with pytest.raises(ProtocolError, match="tag"):
        receiver.unprotect(packet)
    assert receiver.unprotect(protect(other, 0, b"")) == (5, b"")


def test_a_receiver_holds_so_many_keys_and_no_more() -> None:
    receiver = Unprotector()
    keys = [derive_key(BASE_KEY, number) for number in range(MAX_KEYS + 1)]
    for each in keys:
        receiver.add(each)
    with pytest.raises(ProtocolError, match="unknown key ID 0"):
        receiver.unprotect(protect(keys[0], 0, b""))
    for each in keys[1:]:
        receiver.unprotect(protect(each, 0, b""))


def test_a_window_takes_what_is_late_but_not_what_is_too_old() -> None:
    window = ReplayWindow()
    window.take(5000)
    window.take(5001 - REPLAY_WINDOW)
    with pytest.raises(ProtocolError, match="came before"):
        window.take(5001 - REPLAY_WINDOW)
    with pytest.raises(ProtocolError, match=f"is {REPLAY_WINDOW} behind the newest"):
        window.take(5000 - REPLAY_WINDOW)
    window.take(COUNTER_LIMIT - 1)
    with pytest.raises(ProtocolError, match="behind the newest"):
        window.take(5001)
    window.take(COUNTER_LIMIT - 2)


@given(st.lists(st.integers(0, 3 * REPLAY_WINDOW), max_size=60))
def test_no_counter_is_taken_twice(counters: list[int]) -> None:
    window, taken, newest = ReplayWindow(), set[int](), -1
    for counter in counters:
        new = counter not in taken and counter > newest - REPLAY_WINDOW
        if new:
            window.take(counter)
            taken.add(counter)
            newest = max(newest, counter)
        else:
            with pytest.raises(ProtocolError):
                window.take(counter)
