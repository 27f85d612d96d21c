"""Messages for the tests of delivery over a link."""

from protocol.link.delivery.item_assembly import ItemAssembly
from protocol.link.messages import (
    PIECE_BYTES,
    Channel,
    Hello,
    Piece,
    Role,
    serialise_message,
)
from protocol.packets import LayerPacket, serialise

ENCODER, DECODER = b"encoder1", b"decoder1"
LAYER = serialise(LayerPacket(0, 0, bytes(2 * PIECE_BYTES)))


def pieces(item: int, packet: bytes, channel: Channel = Channel.UNORDERED) -> list[Piece]:
    """All pieces of an item, with frame number 0."""
    count = max(1, -(-len(packet) // PIECE_BYTES))
    return [
        Piece(channel, item, 0, len(packet), i, packet[PIECE_BYTES * i :][:PIECE_BYTES])
        for i in range(count)
    ]


def added(items: ItemAssembly, *all_pieces: Piece) -> list[bytes]:
    """The packets that are complete by these pieces."""
    return [packet for piece in all_pieces for _, packet in items.add(piece)]


def hello(role: Role, session: bytes, **fields: object) -> bytes:
    """A HELLO."""
    return serialise_message(Hello(role, session, **fields))  # type: ignore[arg-type]
