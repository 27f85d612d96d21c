"""SFrame (RFC 9605), cipher suite AES_128_CTR_HMAC_SHA256_32: packets encrypted end to end.

A protected packet is a header (key ID, counter), the ciphertext, and four bytes of tag over both
and over metadata that both ends know.  Two packets under one key must never have the same counter:
each sender has a key of its own, and a new one whenever it starts.
"""

import secrets
from dataclasses import dataclass, field

from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CTR
from cryptography.hazmat.primitives.constant_time import bytes_eq
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.hmac import HMAC
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from protocol.errors import ProtocolError

CIPHER_SUITE = 0x0003
TAG_BYTES = 4
KEY_ID_LIMIT = COUNTER_LIMIT = 1 << 64
# How far a packet may be behind the newest one and yet be taken.
REPLAY_WINDOW = 1024
# How far it may be ahead.
MAX_AHEAD = 1 << 20
# Key IDs of sessions; they stand in the header's first byte.
SESSION_KEY_IDS = range(1, 8)

_CIPHER_KEY_BYTES, _AUTHENTICATION_KEY_BYTES, _NONCE_BYTES = 16, 32, 12
_COUNTER_BLOCK_END = bytes(16 - _NONCE_BYTES)
# A key ID or counter below this stands in the header's first byte.
_SHORT = 8


@dataclass(frozen=True, slots=True)
class Key:
    """What packets of one key ID are protected with, derived by `derive_key`."""

    key_id: int
    cipher: bytes = field(repr=False)
    authentication: bytes = field(repr=False)
    salt: bytes = field(repr=False)


def derive_key(base_key: bytes, key_id: int) -> Key:
    """Keys and salt for a key ID (0..2^64 - 1) from a base key (RFC 9605, section 4.4.2)."""
    if not 0 <= key_id < KEY_ID_LIMIT:
        raise ValueError(f"key ID is {key_id}, expected 0..{KEY_ID_LIMIT - 1}")
    label = key_id.to_bytes(8, "big") + CIPHER_SUITE.to_bytes(2, "big")
    length = _CIPHER_KEY_BYTES + _AUTHENTICATION_KEY_BYTES
    key = _expanded(base_key, b"SFrame 1.0 Secret key " + label, length)
    salt = _expanded(base_key, b"SFrame 1.0 Secret salt " + label, _NONCE_BYTES)
    return Key(key_id, key[:_CIPHER_KEY_BYTES], key[_CIPHER_KEY_BYTES:], salt)


def derive_base_key(invitation_key: bytes, sender: str, call: str) -> bytes:
    """The base key of one direction of a call.

    sender: which end sends, as "encoder".  call: the call's name.
    """
    info = b"risorius 1\0" + sender.encode() + b"\0" + call.encode()
    return _expanded(invitation_key, info, _CIPHER_KEY_BYTES)


def random_session() -> int:
    """A number of 64 bits for a sender that starts: no two ever have the same."""
    return secrets.randbits(64)


def derive_session_key(base_key: bytes, session: int) -> Key:
    """The key of most packets of a sender that has the number `session`.

    Its key ID, one of `SESSION_KEY_IDS`, does not tell the number: who shall read the packets must
    be told it, in a packet under another key.
    """
    info = b"risorius session\0" + session.to_bytes(8, "big")
    key_id = SESSION_KEY_IDS[session % len(SESSION_KEY_IDS)]
    return derive_key(_expanded(base_key, info, _CIPHER_KEY_BYTES), key_id)


def serialise_header(key_id: int, counter: int) -> bytes:
    """The header of a packet (RFC 9605, section 4.3)."""
    first, rest = 0, b""
    for value, shift in ((key_id, 4), (counter, 0)):
        if value < _SHORT:
            first |= value << shift
        else:
            length = (value.bit_length() + 7) // 8
            first |= (_SHORT | length - 1) << shift
            rest += value.to_bytes(length, "big")
    return bytes([first]) + rest


def parse_header(data: bytes) -> tuple[int, int, int]:
    """Key ID, counter and length in bytes of the header that `data` begins with.

    Raises `ProtocolError` if it is cut off or longer than need be.
    """
    if not data:
        raise ProtocolError("protected packet: empty")
    place, values = 1, []
    for code in (data[0] >> 4, data[0] & 15):
        if code < _SHORT:
            values.append(code)
            continue
        length = code - _SHORT + 1
        field_bytes = data[place : place + length]
        if len(field_bytes) < length:
            raise ProtocolError(f"protected packet: header cut off after {len(data)} bytes")
        values.append(int.from_bytes(field_bytes, "big"))
        place += length
    key_id, counter = values
    if serialise_header(key_id, counter) != data[:place]:
        raise ProtocolError("protected packet: header longer than need be")
    return key_id, counter, place


def protect(key: Key, counter: int, plaintext: bytes, metadata: bytes = b"") -> bytes:
    """A packet under a key, with a counter that none under this key had before.

    metadata: is authenticated, not sent.
    """
    if not 0 <= counter < COUNTER_LIMIT:
        raise ValueError(f"counter is {counter}, expected 0..{COUNTER_LIMIT - 1}")
    header = serialise_header(key.key_id, counter)
    nonce = _nonce(key, counter)
    ciphertext = _in_counter_mode(key, nonce, plaintext)
    return header + ciphertext + _tag(key, nonce, header + metadata, ciphertext)


def unprotect(key: Key, packet: bytes, metadata: bytes = b"") -> tuple[int, bytes]:
    """Counter and plaintext of a packet under a key.

    Raises `ProtocolError` if it is of another key, or not as it was sent.
    """
    key_id, counter, start = parse_header(packet)
    if key_id != key.key_id:
        raise ProtocolError(f"protected packet: key ID {key_id}, expected {key.key_id}")
    end = len(packet) - TAG_BYTES
    if end < start:
        raise ProtocolError(f"protected packet: {len(packet)} bytes leave no room for a tag")
    header, ciphertext = packet[:start], packet[start:end]
    nonce = _nonce(key, counter)
    expected = _tag(key, nonce, header + metadata, ciphertext)
    if not bytes_eq(expected, packet[end:]):
        raise ProtocolError("protected packet: its tag does not match")
    return counter, _in_counter_mode(key, nonce, ciphertext)


class ReplayWindow:
    """Which counters of one key have come, as far as `REPLAY_WINDOW` behind the newest.

    newest: the newest counter so far; it and all before it count as come.
    """

    def __init__(self, newest: int = -1) -> None:
        self.newest = newest
        self._seen = (1 << REPLAY_WINDOW) - 1  # bit i: newest - i has come

    def can_take(self, counter: int) -> bool:
        """Whether `take` would take a counter.

        It refuses counters more than `MAX_AHEAD` ahead: so many packets are not lost in a row.
        """
        behind = self.newest - counter
        if behind < 0:
            return -behind <= MAX_AHEAD
        return behind < REPLAY_WINDOW and not self._seen >> behind & 1

    def take(self, counter: int) -> bool:
        """Note a counter; False: it came before, or is too old or too far ahead to tell."""
        if not self.can_take(counter):
            return False
        behind = self.newest - counter
        if behind >= 0:
            self._seen |= 1 << behind
        else:
            # No more bits than the window has, however far ahead.
            shift = min(-behind, REPLAY_WINDOW)
            self._seen = (self._seen << shift | 1) & (1 << REPLAY_WINDOW) - 1
            self.newest = counter
        return True


def _expanded(base_key: bytes, info: bytes, length: int) -> bytes:
    return HKDF(SHA256(), length, salt=b"", info=info).derive(base_key)


def _nonce(key: Key, counter: int) -> bytes:
    mask = int.from_bytes(key.salt, "big")
    return (mask ^ counter).to_bytes(_NONCE_BYTES, "big")


def _in_counter_mode(key: Key, nonce: bytes, data: bytes) -> bytes:
    """Encrypts and decrypts alike."""
    coder = Cipher(AES(key.cipher), CTR(nonce + _COUNTER_BLOCK_END)).encryptor()
    return coder.update(data) + coder.finalize()


def _tag(key: Key, nonce: bytes, authenticated: bytes, ciphertext: bytes) -> bytes:
    """RFC 9605, section 4.5.1."""
    code = HMAC(key.authentication, SHA256())
    for size in (len(authenticated), len(ciphertext), TAG_BYTES):
        code.update(size.to_bytes(8, "big"))
    code.update(nonce + authenticated + ciphertext)
    return code.finalize()[:TAG_BYTES]
