"""What the sender of a call keeps for decoders that lack it: packets that have to arrive."""

from dataclasses import dataclass

from protocol.limits import SEQUENCE_MODULUS
from protocol.link.delivery.model_cache import ModelCache
from protocol.link.messages import PIECE_BYTES, Channel, Piece, Span, piece_count
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind, parse_packet

PieceKey = tuple[Channel, int, int]


@dataclass(frozen=True, slots=True)
class Item:
    """A packet that has to arrive, with the number of `messages.Piece`."""

    number: int
    packet: bytes

    @property
    def pieces(self) -> int:
        """How many pieces the item takes; one if it is not needed any more."""
        return max(1, piece_count(len(self.packet)))


@dataclass(frozen=True, slots=True)
class Placed:
    """The pieces of an item.  first: see `messages.Piece.number`."""

    first: int
    pieces: tuple[PieceKey, ...]


NOT_NEEDED = Item(0, b"")


class ItemStore:
    """The items of both channels, by their numbers.

    The unordered channel holds model and layer packets: those of the versions in use and to come.
    The ordered one holds all other packets that have to arrive; keeps_all: also for a decoder that
    joins later, which otherwise needs the last of them only.
    """

    def __init__(self, keeps_all: bool) -> None:
        self._keeps_all = keeps_all
        self._models = ModelCache()
        self._items: dict[Channel, dict[int, Item]] = {channel: {} for channel in Channel}
        self._end = dict.fromkeys(Channel, 0)

    def span(self, channel: Channel) -> Span:
        """The items that a decoder needs which joins now."""
        items, end = self._items[channel], self._end[channel]
        if channel is Channel.ORDERED and not self._keeps_all:
            return Span(max(end - 1, 0), end)
        return Span(min(items, default=end), end)

    def get(self, channel: Channel, number: int) -> Item:
        """An item below the end of its span."""
        return self._items[channel].get(number, NOT_NEEDED)

    def has(self, key: PieceKey) -> bool:
        """Whether there is such a piece, still; what is ordered stays."""
        channel, number, index = key
        is_needed = channel is Channel.ORDERED or number >= self.span(channel).first
        return is_needed and index < self.get(channel, number).pieces

    def piece(self, key: PieceKey) -> Piece:
        """One piece of an item."""
        channel, number, index = key
        item = self.get(channel, number)
        data = item.packet[index * PIECE_BYTES :][:PIECE_BYTES]
        return Piece(channel, number, item.number, len(item.packet), index, data)

    def add(self, packet: bytes, frames: int) -> Placed:
        """Add a packet; where it is.  frames: number of the next frame packet."""
        kind = packet_kind(packet)
        self._models.on_sent(packet)
        is_ordered = self._keeps_all or kind is PacketKind.CONTROL
        channel = Channel.ORDERED if is_ordered else Channel.UNORDERED
        return self._append(channel, Item(_first_frame(packet, frames), packet))

    def on_frame(self, packet: bytes) -> None:
        """A frame packet is sent: what it makes superfluous is dropped."""
        before = self._models.packets
        self._models.on_sent(packet)
        if self._models.packets != before:
            self._adopt(self._models.packets)

    def _append(self, channel: Channel, item: Item) -> Placed:
        number = self._end[channel]
        self._items[channel][number] = item
        self._end[channel] += 1
        return Placed(item.number, tuple((channel, number, i) for i in range(item.pieces)))

    def _adopt(self, packets: tuple[bytes, ...]) -> None:
        """Keep these model and layer packets only; a model may have got pictures."""
        kept: dict[int, Item] = {}
        for number, item in self._items[Channel.UNORDERED].items():
            same = [packet for packet in packets if _identity(packet) == _identity(item.packet)]
            if same:
                kept[number] = Item(item.number, same[0])
        self._items[Channel.UNORDERED] = kept


def _identity(packet: bytes) -> bytes | int:
    """What a packet keeps when pictures are added to its model: the version."""
    if packet_kind(packet) is PacketKind.MODEL:
        model = parse_packet(packet)
        assert isinstance(model, ModelPacket)
        return model.version
    return packet


def _first_frame(packet: bytes, frames: int) -> int:
    """Full number of the first frame packet coded by a model; for others that of the next one."""
    if packet_kind(packet) is not PacketKind.MODEL:
        return frames
    return frames + (packet[0] - frames) % SEQUENCE_MODULUS
