"""Invitations: address, call name and key of a call, in one line.

    risorius://192.0.2.7:7447/anna#K7Q2-8MDX-0V4R-T9NB-ZZ1C-5GHW-P3JE

The key is 128 random bits and a checksum of 12, five bits a character, in Crockford's base 32: no
letters that look like digits, case and dashes without meaning.  The checksum notices every wrong
character and every two that changed places.
"""

import re
import secrets
from dataclasses import dataclass, field

from protocol.errors import ProtocolError
from protocol.limits import CALL_NAME, DEFAULT_PORT, MAX_PORT

SCHEME = "risorius"
KEY_BYTES = 16
MAX_INVITATION_CHARACTERS = 512

_ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
# What people read instead.
_LOOKALIKES = str.maketrans("ILO", "110", "-")
_KEY_CHARACTERS, _GROUP_CHARACTERS = 28, 4
_CHECKSUM_BITS = 12
# CRC-12, x^12 + x^11 + x^3 + x^2 + x + 1: any error within 12 bits in a row changes it.
_CHECKSUM_POLYNOMIAL = 0x180F
_INVITATION = re.compile(
    r"(?i:risorius)://(?P<host>\[[0-9A-Fa-f:.]+\]|[^\s:/?#@\[\]]+)(:(?P<port>\d{1,5}))?"
    r"/(?P<call>[A-Za-z0-9_.-]+)#(?P<key>[0-9A-Za-z-]+)"
)
_HOST = re.compile(r"[^\s:/?#@\[\]]+|[0-9A-Fa-f:.]+")


@dataclass(frozen=True, slots=True)
class Invitation:
    """What who is invited to a call needs: where it is, its name and its key.

    host: name or address; an IPv6 address without brackets.
    key: `KEY_BYTES` secret bytes, left out of `repr`.
    Raises `ValueError` if a field cannot be.
    """

    host: str
    port: int
    call: str
    key: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if not _HOST.fullmatch(self.host):
            raise ValueError(f"host is {self.host!r}, expected a name or an address")
        if not 1 <= self.port <= MAX_PORT:
            raise ValueError(f"port is {self.port}, expected 1..{MAX_PORT}")
        if not CALL_NAME.fullmatch(self.call):
            raise ValueError(f"call is {self.call!r}, expected letters, digits, _ . -")
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"key has {len(self.key)} bytes, expected {KEY_BYTES}")

    @property
    def address(self) -> str:
        """HOST:PORT, as endpoints have it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"

    def __str__(self) -> str:
        """The line to hand over; `parse_invitation` reads it."""
        return f"{SCHEME}://{self.address}/{self.call}#{format_key(self.key)}"


def random_key() -> bytes:
    """A new key from the system's source of secrets."""
    return secrets.token_bytes(KEY_BYTES)


def parse_invitation(text: str) -> Invitation:
    """The invitation in a line, or in a file of one line; white space around it is left out.

    Raises `ProtocolError` if it is none, or its key was copied wrongly; the key is not repeated.
    """
    line = text.strip()
    if len(line) > MAX_INVITATION_CHARACTERS:
        raise ProtocolError(f"an invitation has at most {MAX_INVITATION_CHARACTERS} characters")
    parts = _INVITATION.fullmatch(line)
    if parts is None:
        raise ProtocolError(f"no invitation: expected {SCHEME}://HOST:PORT/CALL#KEY")
    port = int(parts["port"] or DEFAULT_PORT)
    try:
        return Invitation(parts["host"].strip("[]"), port, parts["call"], parse_key(parts["key"]))
    except ValueError as error:
        raise ProtocolError(f"no invitation: {error}") from error


def format_key(key: bytes) -> str:
    """A key of `KEY_BYTES` bytes and its checksum, in groups of characters."""
    bits = int.from_bytes(key, "big")
    code = bits << _CHECKSUM_BITS | _checksum(bits)
    characters = [_ALPHABET[code >> 5 * i & 31] for i in reversed(range(_KEY_CHARACTERS))]
    groups = range(0, _KEY_CHARACTERS, _GROUP_CHARACTERS)
    return "-".join("".join(characters[start : start + _GROUP_CHARACTERS]) for start in groups)


def parse_key(text: str) -> bytes:
    """The key that `format_key` wrote.  Raises `ProtocolError` if it was copied wrongly."""
    characters = text.upper().translate(_LOOKALIKES)
    if len(characters) != _KEY_CHARACTERS:
        raise ProtocolError(
            f"the invitation's key has {len(characters)} characters, expected {_KEY_CHARACTERS}"
        )
    code = 0
    for character in characters:
        value = _ALPHABET.find(character)
        if value < 0:
            raise ProtocolError(f"the invitation's key has a {character!r}, which none has")
        code = code << 5 | value
    bits, checksum = divmod(code, 1 << _CHECKSUM_BITS)
    if _checksum(bits) != checksum:
        raise ProtocolError("the invitation's key was copied wrongly: its checksum does not match")
    return bits.to_bytes(KEY_BYTES, "big")


def _checksum(bits: int) -> int:
    """The remainder of a key's bits, as a polynomial over GF(2), by the checksum's."""
    rest = bits << _CHECKSUM_BITS
    for shift in reversed(range(8 * KEY_BYTES)):
        if rest >> shift + _CHECKSUM_BITS & 1:
            rest ^= _CHECKSUM_POLYNOMIAL << shift
    return rest
