"""Which piece of which item goes out when, to the decoders that lack it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from protocol.link.delivery.item_store import ItemStore, PieceKey
from protocol.link.delivery.piece_window import PieceWindow, Sent
from protocol.link.messages import PIECE_BYTES, Channel, Holding, Piece, Report, peer_id

# A decoder that has not reported a piece for so long after it had has begun its item anew.
FORGOTTEN_S = 1.0


@dataclass(frozen=True, slots=True)
class Held:
    """What a decoder has of an item.

    pieces: bit i is piece i.  grown_s: when more of them had come than before.
    """

    pieces: int
    grown_s: float


NOTHING = Held(0, float("-inf"))


@dataclass(slots=True)
class Peer:
    """A decoder: what it has, by its reports.

    Of many some have the same `peer_id`, by which alone reports name them.  They count as one that
    has what the newest of their reports says: who lacks something says so again and again.

    others: sessions of the decoders with its `peer_id`.
    held: of the items that are not below `below`.
    answered: the newest nonce without padding that it has answered, and when that came.
    """

    session: bytes
    heard_s: float
    others: set[bytes] = field(default_factory=set)
    below: dict[Channel, int] = field(default_factory=lambda: dict.fromkeys(Channel, 0))
    held: dict[tuple[Channel, int], Held] = field(default_factory=dict)
    loss: float = 0.0
    window: PieceWindow = field(default_factory=PieceWindow)
    answered_s: float = float("-inf")
    answered: tuple[int, float] = (0, 0.0)
    probes: int = 0
    probed_s: float = float("-inf")
    has_reported: bool = False

    def lacks(self, key: PieceKey) -> bool:
        """Whether the decoder needs a piece."""
        channel, item, index = key
        if item < self.below[channel]:
            return False
        return not self.held.get((channel, item), NOTHING).pieces >> index & 1

    def hold(self, held: Holding, now_s: float) -> None:
        """Take over which pieces of an item the decoder has, as one of its reports says."""
        item = held.channel, held.item
        before = self.held.get(item, NOTHING)
        is_forgotten = before.pieces & ~held.pieces and now_s - before.grown_s > FORGOTTEN_S
        pieces = held.pieces | (0 if is_forgotten else before.pieces)
        self.held[item] = before if pieces == before.pieces else Held(pieces, now_s)

    def forget_below(self) -> None:
        """Forget the pieces of items that the decoder has whole."""
        for item in [each for each in self.held if each[1] < self.below[each[0]]]:
            del self.held[item]


class PieceSchedule:
    """The pieces of some items on their way to any number of decoders."""

    def __init__(self, items: ItemStore) -> None:
        self._items = items
        self._sent: dict[PieceKey, Sent] = {}

    def needed(self, peers: Sequence[Peer]) -> Iterator[PieceKey]:
        """The pieces that some of these decoders lack, in the order of their items."""
        for channel in Channel if peers else ():
            span = self._items.span(channel)
            begin = min(peer.below[channel] for peer in peers)
            if channel is Channel.UNORDERED:
                begin = max(span.first, begin)
            for number in range(begin, span.end):
                for index in range(self._items.get(channel, number).pieces):
                    key = channel, number, index
                    if any(peer.lacks(key) for peer in peers):
                        yield key

    def is_behind(self, peer: Peer) -> bool:
        """Whether a decoder waits for items that nobody needs any more, and does not know it."""
        channel = Channel.UNORDERED
        return peer.below[channel] < self._items.span(channel).first

    def acknowledge(self, peer: Peer, report: Report, peers: Sequence[Peer], now_s: float) -> bool:
        """Take over what a decoder, one of `peers`, has; whether that is more than before."""
        before = replace(peer, below=dict(peer.below), held=dict(peer.held))
        ends = {channel: self._items.span(channel).end for channel in Channel}
        if peer.others:
            peer.below, peer.held = dict.fromkeys(Channel, 0), {}
        for channel, below in zip(Channel, (report.ordered, report.unordered), strict=True):
            peer.below[channel] = min(max(peer.below[channel], below), ends[channel])
        for held in report.holdings:
            if held.item < ends[held.channel]:
                peer.hold(held, now_s)
        peer.forget_below()
        has_more = False
        for key, sent in list(self._sent.items()):
            if before.lacks(key) and not peer.lacks(key):
                size = len(self._items.piece(key).data)
                peer.window.on_piece(sent, size, now_s)
                has_more = True
                # The newest decoders lack most.
                if not any(each.lacks(key) for each in reversed(peers)):
                    del self._sent[key]
        return has_more

    def due(self, peers: Sequence[Peer], now_s: float) -> Iterator[Piece]:
        """Pieces that were lost, then new ones as far as the windows allow."""
        peers = self._incomplete(peers)
        flying = {peer_id(peer.session): 0 for peer in peers}
        lost = list[PieceKey]()
        self._sent = {key: sent for key, sent in self._sent.items() if self._items.has(key)}
        for key, sent in self._sent.items():
            lacking = [peer for peer in peers if peer.lacks(key)]
            waiting_bytes = PIECE_BYTES * len(self._sent)
            if any(peer.window.is_lost(sent, now_s, waiting_bytes) for peer in lacking):
                lost.append(key)
            for peer in lacking:
                flying[peer_id(peer.session)] += 1
        for key in lost:
            yield self._sent_piece(key, peers, now_s)
        for key in self.needed(peers):
            if key in self._sent:
                continue
            lacking = [peer for peer in peers if peer.lacks(key)]
            if any(flying[peer_id(peer.session)] >= peer.window.size for peer in lacking):
                return
            for peer in lacking:
                flying[peer_id(peer.session)] += 1
            yield self._sent_piece(key, peers, now_s)

    def forget_sent(self, peers: Sequence[Peer]) -> None:
        """A decoder has left: what none of the others lacks is not on its way any more."""
        for key in [key for key in self._sent if not any(each.lacks(key) for each in peers)]:
            del self._sent[key]

    def _incomplete(self, peers: Sequence[Peer]) -> list[Peer]:
        """The decoders that lack something."""
        ends = [(channel, self._items.span(channel).end) for channel in Channel]
        return [peer for peer in peers if any(peer.below[channel] < end for channel, end in ends)]

    def _sent_piece(self, key: PieceKey, peers: Sequence[Peer], now_s: float) -> Piece:
        delivered = min(peer.window.delivered for peer in peers if peer.lacks(key))
        again = key in self._sent
        flying = PIECE_BYTES * (len(self._sent) + (not again))
        self._sent[key] = Sent(now_s, delivered, flying, again)
        return self._items.piece(key)
