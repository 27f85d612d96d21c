"""Which direction each end of a two-way call sends in, where both connect to a relay.

A two-way call NAME is two calls, `NAME-a` and `NAME-b`.  Whoever listens sends in direction a.  Of
two that connect, each says on the key n/NAME what it sends in, or asks; who is asked says so:

    magic b"N", identifier of the end (8 bytes), direction (0 asks, 1 a, 2 b), tag (16 bytes)

The tag is an HMAC-SHA256 of what precedes and of the name, by the call's key, cut off; without one
by the key b"".  Who hears nobody takes a; of two who had heard nobody the one with the smaller
identifier, and of one who listens and another the other one, takes b.  A listener's identifier is
the largest.
"""

import hmac
from dataclasses import dataclass
from enum import IntEnum
from hashlib import sha256

MAGIC = b"N"
ID_BYTES, TAG_BYTES = 8, 16
LISTENER = bytes([255]) * ID_BYTES
MESSAGE_BYTES = len(MAGIC) + ID_BYTES + 1 + TAG_BYTES


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
    """sender: identifier of the end, `ID_BYTES` bytes."""

    sender: bytes
    direction: Direction

    def serialise(self, name: str, key: bytes) -> bytes:
        """The bytes of the message.  name, key: of the call."""
        head = MAGIC + self.sender + bytes([self.direction])
        return head + _tag(head, name, key)


def parse_direction(data: bytes, name: str, key: bytes) -> DirectionMessage | None:
    """The message; None if it is none, or not of somebody with this key."""
    head, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
    if len(data) != MESSAGE_BYTES or not data.startswith(MAGIC) or head[-1] not in list(Direction):
        return None
    if not hmac.compare_digest(tag, _tag(head, name, key)):
        return None
    return DirectionMessage(head[len(MAGIC) : -1], Direction(head[-1]))


def _tag(head: bytes, name: str, key: bytes) -> bytes:
    return hmac.new(key, head + name.encode(), sha256).digest()[:TAG_BYTES]


class DirectionNegotiation:
    """One end's side of it; does no input or output.

    identifier: random, `ID_BYTES` bytes.  is_listener: the end has direction a in any case.
    direction: None until it is settled.
    has_changed: it is another than the one that was settled first.
    """

    def __init__(self, identifier: bytes, is_listener: bool = False) -> None:
        self._identifier = LISTENER if is_listener else identifier
        self.direction = Direction.A if is_listener else None
        self.has_changed = False
        # Once another end has the other direction nobody else can change one's own.
        self._has_partner = is_listener

    @property
    def message(self) -> DirectionMessage:
        """What to say now."""
        return DirectionMessage(self._identifier, self.direction or Direction.ASKS)

    def receive(self, message: DirectionMessage) -> bool:
        """Take what another end says; returns whether to say something in turn."""
        if message.sender == self._identifier:
            return False
        is_larger = self._identifier > message.sender
        if self.direction is None:
            asks = message.direction is Direction.ASKS
            self.direction = message.direction.other if not asks else _by_size(is_larger)
            self._has_partner = not asks
            return True
        if message.direction is self.direction.other:
            self._has_partner = True
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
