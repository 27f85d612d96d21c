"""What the two ends of a two-way call say of themselves: direction, name, microphone.

A two-way call NAME is two calls, `NAME-a` and `NAME-b`.  Whoever listens sends in direction a.  Of
two that connect, each says on the key n/NAME what it sends in, or asks; who is asked says so:

    magic b"N", identifier of the end (8 bytes), direction (0 asks, 1 a, 2 b), nonce (12 bytes),
    sealed: flags (bit 0: the microphone is off), name of the person, UTF-8

Sealed is AES-256-GCM by the SHA-256 of the call's key (without one of b""), over what stands before
the nonce and the name of the call.  Who hears nobody takes a; of two who had heard nobody the one
with the smaller identifier, and of one who listens and another the other one, takes b.  A
listener's identifier is the largest.
"""

import secrets
from dataclasses import dataclass
from enum import IntEnum
from hashlib import sha256

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

MAGIC = b"N"
ID_BYTES, NONCE_BYTES, TAG_BYTES = 8, 12, 16
LISTENER = bytes([255]) * ID_BYTES
HEAD_BYTES = len(MAGIC) + ID_BYTES + 1
MAX_NAME_BYTES = 64
MIN_MESSAGE_BYTES = HEAD_BYTES + NONCE_BYTES + 1 + TAG_BYTES
_MUTED = 1


class Direction(IntEnum):
    """What an end sends in."""

    ASKS = 0
    A = 1
    B = 2

    @property
    def other(self) -> "Direction":
        """That of the other end."""
        return Direction.B if self is Direction.A else Direction.A


def direction_key(name: str) -> str:
    """The key on which the ends of call `name` settle their directions."""
    return f"n/{name}"


@dataclass(frozen=True, slots=True)
class DirectionMessage:
    """sender: identifier of the end, `ID_BYTES` bytes.

    person: name of who is there, empty if they do not say.  is_muted: their microphone is off.
    """

    sender: bytes
    direction: Direction
    person: str = ""
    is_muted: bool = False

    def serialise(self, name: str, key: bytes) -> bytes:
        """The bytes of the message.  name, key: of the call."""
        head = MAGIC + self.sender + bytes([self.direction])
        said = bytes([_MUTED * self.is_muted]) + cut_name(self.person).encode()
        nonce = secrets.token_bytes(NONCE_BYTES)
        return head + nonce + _cipher(key).encrypt(nonce, said, head + name.encode())


def cut_name(person: str) -> str:
    """A person's name as far as a message holds it, in one line."""
    line = " ".join(person.split()).encode()[:MAX_NAME_BYTES]
    return line.decode("utf-8", "ignore")


def parse_direction(data: bytes, name: str, key: bytes) -> DirectionMessage | None:
    """The message; None if it is none, or not of somebody with this key."""
    head, nonce = data[:HEAD_BYTES], data[HEAD_BYTES : HEAD_BYTES + NONCE_BYTES]
    most = MIN_MESSAGE_BYTES + MAX_NAME_BYTES
    if not MIN_MESSAGE_BYTES <= len(data) <= most or not data.startswith(MAGIC):
        return None
    if head[-1] not in list(Direction):
        return None
    try:
        said = _cipher(key).decrypt(nonce, data[HEAD_BYTES + NONCE_BYTES :], head + name.encode())
    except InvalidTag:
        return None
    person = cut_name(said[1:].decode("utf-8", "replace"))
    return DirectionMessage(head[1:-1], Direction(head[-1]), person, bool(said[0] & _MUTED))


def _cipher(key: bytes) -> AESGCM:
    return AESGCM(sha256(key).digest())


class DirectionNegotiation:
    """One end's side of it; does no input or output.

    identifier: random, `ID_BYTES` bytes.  is_listener: the end has direction a in any case.
    person: see `DirectionMessage`; is_muted may be set.
    direction: None until it is settled.
    other: what the other end has said last; None: nothing yet.
    has_changed: it is another than the one that was settled first.
    """

    def __init__(self, identifier: bytes, is_listener: bool = False, person: str = "") -> None:
        self.other: DirectionMessage | None = None
        self._person, self.is_muted = person, False
        self._identifier = LISTENER if is_listener else identifier
        self.direction = Direction.A if is_listener else None
        self.has_changed = False
        # Once another end has the other direction nobody else can change one's own.
        self._has_partner = is_listener

    @property
    def message(self) -> DirectionMessage:
        """What to say now."""
        direction = self.direction or Direction.ASKS
        return DirectionMessage(self._identifier, direction, self._person, self.is_muted)

    def receive(self, message: DirectionMessage) -> bool:
        """Take what another end says; returns whether to say something in turn."""
        if message.sender == self._identifier:
            return False
        is_larger = self._identifier > message.sender
        if self.direction is None:
            asks = message.direction is Direction.ASKS
            self.direction = message.direction.other if not asks else _by_size(is_larger)
            self._has_partner, self.other = not asks, None if asks else message
            return True
        if message.direction is self.direction.other:
            self._has_partner, self.other = True, message
        elif message.direction is self.direction and not self._has_partner:
            # Both had heard nobody.
            if not is_larger:
                self.direction, self.has_changed = self.direction.other, True
            return True
        return message.direction is Direction.ASKS

    def hear_nobody(self) -> None:
        """Nobody has said anything in time."""
        self.direction = self.direction or Direction.A


def _by_size(is_larger: bool) -> Direction:
    return Direction.A if is_larger else Direction.B
