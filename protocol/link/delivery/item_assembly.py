"""Items of a call put together from their pieces, by the decoder's end of a link."""

from dataclasses import dataclass, field

from protocol.errors import ProtocolError
from protocol.link.messages import (
    MAX_HOLDINGS,
    PIECE_BYTES,
    Channel,
    Holding,
    Piece,
    Span,
    piece_count,
)
from protocol.packets import packet_kind

# Items beyond the first that is missing, and bytes of pieces and packets that wait for others.
MAX_AHEAD, MAX_HELD_BYTES = 4096, 2 * 1024 * 1024
# Bytes of all bitmaps in one report.
MAX_HOLDING_BYTES = 600


@dataclass(slots=True)
class _Partial:
    """The pieces of an item.

    packet: of an item that is complete and waits for those before it.
    """

    total: int
    number: int
    pieces: dict[int, bytes] = field(default_factory=dict)
    is_complete: bool = False
    packet: bytes = b""

    @property
    def bits(self) -> int:
        if self.is_complete:
            return (1 << max(1, piece_count(self.total))) - 1
        return sum(1 << index for index in self.pieces)


@dataclass(slots=True)
class _Lane:
    below: int = 0
    items: dict[int, _Partial] = field(default_factory=dict)


class ItemAssembly:
    """The items of both channels."""

    def __init__(self) -> None:
        self._lanes = {channel: _Lane() for channel in Channel}
        self._held_bytes = 0

    def begin(self, channel: Channel, span: Span) -> None:
        """Items before `span` are not needed."""
        self._lanes[channel].below = span.first

    def extend(self, channel: Channel, span: Span) -> None:
        """Items before `span` are not needed any more, unless their order matters."""
        lane = self._lanes[channel]
        if channel is Channel.UNORDERED and span.first > lane.below:
            lane.below = span.first
            for number in [number for number in lane.items if number < span.first]:
                self._drop(lane.items.pop(number))
            self._advance(lane)

    def below(self, channel: Channel) -> int:
        """All items below this one are there, or not needed."""
        return self._lanes[channel].below

    def has(self, piece: Piece) -> bool:
        """Whether a piece is there, or not needed."""
        lane = self._lanes[piece.channel]
        part = lane.items.get(piece.item)
        is_there = part is not None and (part.is_complete or piece.index in part.pieces)
        return is_there or piece.item < lane.below

    def add(self, piece: Piece) -> list[tuple[int, bytes]]:
        """The packets that are complete now, each with its number, see `Piece`.

        Raises `ProtocolError` if the piece is too far ahead or more than can be held.
        """
        lane = self._lanes[piece.channel]
        if piece.item < lane.below:
            return []
        if piece.item >= lane.below + MAX_AHEAD:
            raise ProtocolError(f"item {piece.item} is beyond {lane.below + MAX_AHEAD}")
        part = lane.items.get(piece.item)
        if part is None or (part.total != piece.total and not part.is_complete):
            if part is not None:
                self._drop(part)
            part = lane.items[piece.item] = _Partial(piece.total, piece.number)
        if part.is_complete:
            # A model that has got pictures since is the same one.
            part.total = max(part.total, piece.total)
            return []
        if piece.index in part.pieces:
            return []
        # What all others wait for is taken in any case.
        if piece.item > lane.below and self._held_bytes + PIECE_BYTES > MAX_HELD_BYTES:
            raise ProtocolError(f"pieces of more than {MAX_HELD_BYTES} bytes")
        self._hold(part, piece)
        if len(part.pieces) < piece_count(part.total):
            return []
        packet = b"".join(part.pieces[index] for index in sorted(part.pieces))
        if packet:
            packet_kind(packet)
        self._drop(part)
        part.is_complete = True
        if piece.channel is Channel.UNORDERED:
            self._advance(lane)
            return [(part.number, packet)] if packet else []
        part.packet = packet
        self._held_bytes += len(packet)
        return self._advance(lane)

    def holdings(self) -> tuple[Holding, ...]:
        """What has come of the items that are not below `below`."""
        found, size = list[Holding](), 0
        for channel, lane in self._lanes.items():
            for number, part in sorted(lane.items.items()):
                bits = part.bits
                size += 6 + bits.bit_length() // 8
                if len(found) == MAX_HOLDINGS or size > MAX_HOLDING_BYTES:
                    return tuple(found)
                found.append(Holding(channel, number, bits))
        return tuple(found)

    def _hold(self, part: _Partial, piece: Piece) -> None:
        if part.total:
            part.pieces[piece.index] = piece.data
            self._held_bytes += PIECE_BYTES

    def _drop(self, part: _Partial) -> None:
        self._held_bytes -= PIECE_BYTES * len(part.pieces) + len(part.packet)
        part.pieces.clear()
        part.packet = b""

    def _advance(self, lane: _Lane) -> list[tuple[int, bytes]]:
        """The packets of the items that are there without a gap."""
        found = list[tuple[int, bytes]]()
        while (part := lane.items.get(lane.below)) is not None and part.is_complete:
            del lane.items[lane.below]
            lane.below += 1
            if part.packet:
                found.append((part.number, part.packet))
            self._drop(part)
        return found
