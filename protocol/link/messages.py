"""The messages of a link, beside the packets of a call: bytes in, frozen dataclasses out, and back.

A payload of the link is a frame packet as it is, or one of these messages.  Byte 0 of a message is
that of a control packet with number 0, byte 1 its kind, beyond those of control packets.  Every
message has one encoding; any other bytes raise `ProtocolError`.  Specified in docs/format.md.
"""

from dataclasses import dataclass
from enum import IntEnum

from protocol.entropy.validation import check_bytes, check_int
from protocol.entropy.varint import MAX_VARINT, FieldReader, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import (
    MAX_MESSAGE_LENGTH,
    MAX_MODEL_PACKET_BYTES,
    SEQUENCE_MODULUS,
    SESSION_BYTES,
)
from protocol.packets import PacketKind

NO_SESSION = bytes(SESSION_BYTES)
# Bytes of a packet that one piece carries, and the most pieces of a packet.
PIECE_BYTES = 512
MAX_PIECES = -(-MAX_MODEL_PACKET_BYTES // PIECE_BYTES)
MAX_PADDING_BYTES = 512
# What one report says at most.
MAX_HOLDINGS, MAX_MISSING = 32, 32
MAX_MESSAGE_BYTES = 4096
# Of a frame packet or an item.  Reports count beyond what has come, and say 2 items + a channel.
MAX_NUMBER = 2**31 - 1
NONCES = 256

_HEAD = PacketKind.CONTROL * SEQUENCE_MODULUS
# In a HELLO: after byte 0, the kind, the flags and two nonces.
_SESSION_START = 5


class Channel(IntEnum):
    """Items of the ordered channel are delivered in order, those of the other as they come."""

    ORDERED = 0
    UNORDERED = 1


class MessageKind(IntEnum):
    """Byte 1 of a message; control packets have the values below."""

    HELLO = 16
    REPORT = 17
    PIECE_ORDERED = 18
    PIECE_UNORDERED = 19
    BYE = 20


class Role(IntEnum):
    """Which end of a call sends."""

    ENCODER = 0
    DECODER = 1
    RELAY = 2


@dataclass(frozen=True, slots=True)
class Span:
    """The items of a channel that a decoder needs: `first` and those after it, below `end`."""

    first: int = 0
    end: int = 0

    def __post_init__(self) -> None:
        check_int("end of a span", self.end, 0, MAX_NUMBER)
        check_int("first of a span", self.first, 0, self.end)


@dataclass(frozen=True, slots=True)
class Hello:
    """Who sends, and where the call stands.

    session: of the sender.  echo: the other end's, or `NO_SESSION`.
    asks: the other end shall answer at once.  is_busy: a decoder has another encoder.
    nonce: number of this message, 1..255 and again.  answers: the nonce of what it answers, or 0.
    frames: number of the next frame packet.  ordered, unordered: items, by channel.
    padding: bytes without meaning, which measure the link.
    """

    role: Role
    session: bytes
    echo: bytes = NO_SESSION
    asks: bool = False
    is_busy: bool = False
    nonce: int = 0
    answers: int = 0
    frames: int = 0
    ordered: Span = Span()
    unordered: Span = Span()
    padding: int = 0

    def __post_init__(self) -> None:
        for name in ("session", "echo"):
            if len(getattr(self, name)) != SESSION_BYTES:
                raise ValueError(f"{name} has {len(getattr(self, name))} bytes, expected 8")
        check_int("nonce", self.nonce, 0, NONCES - 1)
        check_int("answered nonce", self.answers, 0, NONCES - 1)
        check_int("frames", self.frames, 0, MAX_NUMBER)
        check_int("padding", self.padding, 0, MAX_PADDING_BYTES)


@dataclass(frozen=True, slots=True)
class Holding:
    """Which pieces of an item a decoder has: bit i of `pieces` is piece i."""

    channel: Channel
    item: int
    pieces: int

    def __post_init__(self) -> None:
        check_int("item", self.item, 0, MAX_NUMBER)
        if not 0 < self.pieces < 1 << MAX_PIECES:
            raise ValueError("pieces of a holding: expected at least one, and a possible one")


@dataclass(frozen=True, slots=True)
class Report:
    """What a decoder has and lacks.

    peer: the first two bytes of the decoder's session.
    loss: share of the frame packets that did not arrive the first time, in 1/255.
    frames: number of the newest frame packet and one.
    ordered, unordered: all items below are there.  holdings: of some of those from there on.
    missing: numbers of frame packets that shall be sent again, ascending.
    """

    peer: int
    loss: int = 0
    frames: int = 0
    ordered: int = 0
    unordered: int = 0
    holdings: tuple[Holding, ...] = ()
    missing: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_int("peer", self.peer, 0, 0xFFFF)
        check_int("loss", self.loss, 0, 0xFF)
        for name in ("frames", "ordered", "unordered"):
            check_int(name, getattr(self, name), 0, MAX_VARINT)
        check_int("number of holdings", len(self.holdings), 0, MAX_HOLDINGS)
        check_int("number of missing packets", len(self.missing), 0, MAX_MISSING)
        if list(self.missing) != sorted(set(self.missing)):
            raise ValueError("missing packets are not in order")


@dataclass(frozen=True, slots=True)
class Piece:
    """Piece `index` of an item: `data` is bytes `index * PIECE_BYTES` and on of a packet.

    total: bytes of the packet; 0: the item is not needed any more.
    number: full number of a frame packet: that of the packet itself, of the first one coded by a
        model packet, or of the one after a control packet.
    """

    channel: Channel
    item: int
    number: int
    total: int
    index: int
    data: bytes

    def __post_init__(self) -> None:
        check_int("item", self.item, 0, MAX_NUMBER)
        check_int("number", self.number, 0, MAX_NUMBER)
        check_int("total", self.total, 0, MAX_MODEL_PACKET_BYTES)
        check_int("index", self.index, 0, max(0, piece_count(self.total) - 1))
        expected = len(range(self.index * PIECE_BYTES, self.total)[:PIECE_BYTES])
        if len(self.data) != expected:
            raise ValueError(f"piece has {len(self.data)} bytes, expected {expected}")
        check_bytes("piece", self.data, PIECE_BYTES)


@dataclass(frozen=True, slots=True)
class Bye:
    """The sender leaves.  peer: the first two bytes of its session."""

    role: Role
    peer: int

    def __post_init__(self) -> None:
        check_int("peer", self.peer, 0, 0xFFFF)


Message = Hello | Report | Piece | Bye


def piece_count(total: int) -> int:
    """How many pieces a packet of `total` bytes takes."""
    return -(-total // PIECE_BYTES)


def peer_id(session: bytes) -> int:
    """What stands for a session in reports."""
    return int.from_bytes(session[:2], "big")


def is_message(data: bytes) -> bool:
    """Whether a payload is a message of the link and no frame packet."""
    return len(data) > 1 and data[0] == _HEAD and data[1] >= MessageKind.HELLO


def is_hello(data: bytes) -> bool:
    """Whether a payload begins like a HELLO."""
    return is_message(data) and data[1] == MessageKind.HELLO


def session_in_hello(data: bytes) -> bytes | None:
    """The session that a HELLO names; None if it does not begin like one."""
    session = data[_SESSION_START : _SESSION_START + SESSION_BYTES]
    return bytes(session) if is_hello(data) and len(session) == SESSION_BYTES else None


def serialise_message(message: Message) -> bytes:
    """The bytes of a message."""
    if isinstance(message, Hello):
        kind, body = MessageKind.HELLO, _hello_body(message)
    elif isinstance(message, Report):
        kind, body = MessageKind.REPORT, _report_body(message)
    elif isinstance(message, Piece):
        kind = MessageKind(MessageKind.PIECE_ORDERED + message.channel)
        fields = (message.item, message.number, message.total, message.index)
        body = b"".join(map(encode_varint, fields)) + message.data
    else:
        kind, body = MessageKind.BYE, bytes([message.role]) + message.peer.to_bytes(2, "big")
    return bytes([_HEAD, kind]) + body


def parse_message(data: bytes) -> Message:
    """The message that `data` encodes.

    Raises `ProtocolError` if it is none, or not encoded as `serialise_message` does.
    """
    if not is_message(data):
        raise ProtocolError("not a message of the link")
    if len(data) > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"message of {len(data)} bytes is too long")
    try:
        message = _parse(MessageKind(data[1]), FieldReader(data[2:]))
    except ValueError as error:
        raise ProtocolError(f"message of the link: {error}"[:MAX_MESSAGE_LENGTH]) from error
    if serialise_message(message) != data:
        raise ProtocolError("message of the link: not its one encoding")
    return message


def _parse(kind: MessageKind, reader: FieldReader) -> Message:
    if kind is MessageKind.HELLO:
        return _parse_hello(reader)
    if kind is MessageKind.REPORT:
        return _parse_report(reader)
    if kind is MessageKind.BYE:
        return Bye(Role(reader.byte()), int.from_bytes(reader.take(2), "big"))
    item, number, total, index = (reader.varint() for _ in range(4))
    return Piece(Channel(kind - MessageKind.PIECE_ORDERED), item, number, total, index, reader.rest)


def _hello_body(hello: Hello) -> bytes:
    flags = hello.role | hello.asks << 2 | hello.is_busy << 3
    head = bytes([flags, hello.nonce, hello.answers]) + hello.session + hello.echo
    spans = (hello.ordered, hello.unordered)
    numbers = [hello.frames] + [n for span in spans for n in (span.first, span.end - span.first)]
    return head + b"".join(map(encode_varint, numbers)) + bytes(hello.padding)


def _parse_hello(reader: FieldReader) -> Hello:
    flags, nonce, answers = reader.take(3)
    session, echo = reader.take(SESSION_BYTES), reader.take(SESSION_BYTES)
    return Hello(
        role=Role(flags % 4),
        session=session,
        echo=echo,
        asks=bool(flags & 4),
        is_busy=bool(flags & 8),
        nonce=nonce,
        answers=answers,
        frames=reader.varint(),
        ordered=_parse_span(reader),
        unordered=_parse_span(reader),
        padding=len(reader.rest),
    )


def _report_body(report: Report) -> bytes:
    head = report.peer.to_bytes(2, "big") + bytes([report.loss])
    numbers = [report.frames, report.ordered, report.unordered, len(report.missing)]
    before = 0
    for number in report.missing:
        numbers.append(number - before)
        before = number
    return head + b"".join(map(encode_varint, numbers)) + b"".join(map(_holding, report.holdings))


def _holding(holding: Holding) -> bytes:
    bits = holding.pieces.to_bytes((holding.pieces.bit_length() + 7) // 8, "little")
    return encode_varint(2 * holding.item + holding.channel) + encode_varint(len(bits)) + bits


def _parse_span(reader: FieldReader) -> Span:
    first = reader.varint()
    return Span(first, first + reader.varint())


def _parse_report(reader: FieldReader) -> Report:
    peer, loss = int.from_bytes(reader.take(2), "big"), reader.byte()
    frames, ordered, unordered, missing_count = (reader.varint() for _ in range(4))
    check_int("number of missing packets", missing_count, 0, MAX_MISSING)
    missing = list[int]()
    for _ in range(missing_count):
        missing.append((missing[-1] if missing else 0) + reader.varint())
    holdings = list[Holding]()
    while reader.rest:
        item, channel = divmod(reader.varint(), 2)
        bits = int.from_bytes(reader.take(reader.varint()), "little")
        holdings.append(Holding(Channel(channel), item, bits))
    return Report(peer, loss, frames, ordered, unordered, tuple(holdings), tuple(missing))
