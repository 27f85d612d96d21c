"""What the encoder's end of a link does, without input and output.

Frame packets go out at once, and again when a decoder asks.  All else is kept as items, sent in
pieces until every decoder that is present has them.  Time is an argument, seconds from any origin.
"""

from collections import deque
from collections.abc import Callable, Iterator

from protocol.limits import SEQUENCE_MODULUS
from protocol.link.delivery.item_store import ItemStore, Placed
from protocol.link.delivery.piece_schedule import Peer, PieceSchedule
from protocol.link.delivery.piece_window import SURE_BPS, PieceWindow
from protocol.link.interface import LinkQuality
from protocol.link.messages import (
    NO_SESSION,
    NONCES,
    Bye,
    Channel,
    Hello,
    Report,
    Role,
    parse_message,
    peer_id,
    serialise_message,
)
from protocol.packets import PacketKind, is_end, packet_kind

# Frame packets that can be sent again, and how soon after the last time.
HISTORY = 24
REPEAT_S = 0.09
# To a decoder that misses more than this share a repetition goes three times, so soon one after
# another.
LOSSY, COPIES, AGAIN_S = 0.1, 3, 0.03
# The first frame packets of a call go twice, unless the link is thin: nothing is known of its
# losses, nor does a decoder know when they are due.
EARLY_FRAMES = 4
# A decoder that has been silent for so long is gone; one that has been for less gets no pieces.
PEER_GONE_S, PEER_SILENT_S = 8.0, 4.0
# How long an encoder stays for decoders that say nothing new at the end of a call: if they have all
# of it, and if they lack some, which a link that repeats by itself may hold up for seconds.
LINGER_S, STALLED_S = 4.0, 15.0
# How often the other end is asked who has never answered, first and later; who has become silent.
ASK_S, LATER_ASK_S, FIRST_ASKS = 0.25, 1.0, 20
# How long the frame packets of an update wait until the decoders have it.
UPDATE_PATIENCE_S = 3.0
# How often one decoder is answered.
ANSWER_S = 0.15
# All decoders answer a question: however many there are, so many answers come a second.
ANSWERS_PER_S = 200.0
# The links of more decoders are not measured with padding, which all of them would get.
PROBED_PEERS = 8
# Bytes that a HELLO is padded with to measure the link, and how often that is tried.
PADDING_BYTES, MAX_PROBES = 400, 8
# How long a decoder's word holds that it listens to another encoder.
BUSY_S = 1.5

PeerCallback = Callable[[bytes], None]
# A copy of a packet so far behind the next one might be taken for one that is ahead of it.
MAX_BEHIND = 12


class DeliverySender:
    """Sends one call to any number of decoders.

    session: of this start of the encoder.  lossless: frame packets are items, too.
    on_peer: called with the session of a decoder that has echoed ours.
    rate_bps: what the links carry; None: they are measured.
    progress_s: when a decoder has acknowledged a piece of an item last; -inf: never.
    heard_s: when a decoder was heard last that has not said good-bye; -inf: there is none.
    is_end_heard: a decoder has all of a call that has ended.
    """

    def __init__(
        self, session: bytes, lossless: bool, on_peer: PeerCallback, rate_bps: float | None = None
    ) -> None:
        self._session, self._lossless, self._on_peer = session, lossless, on_peer
        self._rate_bps = rate_bps
        self._items = ItemStore(keeps_all=lossless)
        self._frames = 0
        self._frames_due: deque[tuple[int, bytes]] = deque()
        self._has_model = False
        self._update: Placed | None = None  # a model that no frame packet has been sent of
        self._held_s: float | None = None  # since when frame packets wait for it
        self._history: deque[tuple[int, bytes]] = deque(maxlen=HISTORY)
        self._repeated_s: dict[int, float] = {}
        self._copies = FrameCopies()
        self._peers: dict[int, Peer] = {}
        self._gone: dict[int, bytes] = {}  # sessions of decoders that have said good-bye
        self._pieces = PieceSchedule(self._items)
        self._out: list[bytes] = []
        self._nonce, self._nonces = 0, dict[int, tuple[float, int]]()
        self._asked_s, self._asks = float("-inf"), 0
        self._busy_s = self.progress_s = self.heard_s = float("-inf")
        self._has_ended = self.is_end_heard = False

    @property
    def peers(self) -> frozenset[bytes]:
        """The sessions of the decoders that are present."""
        sessions = ({peer.session, *peer.others} for peer in self._peers.values())
        return frozenset[bytes]().union(*sessions)

    @property
    def quality(self) -> LinkQuality:
        """Of the worst of the decoders' links."""
        windows = [peer.window for peer in self._peers.values()]
        trips = [each.round_trip_s for each in windows if each.round_trip_s is not None]
        rates = [each.rate_bps for each in windows if each.rate_bps is not None]
        loss = max((peer.loss for peer in self._peers.values()), default=0.0)
        return LinkQuality(loss, max(trips, default=None), min(rates, default=None))

    @property
    def is_measured(self) -> bool:
        """Whether the rates of the links to all decoders are known."""
        return all(peer.window.is_measured for peer in self._peers.values())

    def is_busy(self, now_s: float) -> bool:
        """Whether a decoder has said that it listens to another encoder."""
        return now_s - self._busy_s < BUSY_S

    def is_awaited(self, ended_s: float, now_s: float) -> bool:
        """Whether a decoder may still take what it lacks of a call that ended at `ended_s`."""
        peers = list(self._peers.values())
        has_all = bool(peers) and not any(self._pieces.needed(peers))
        patience_s = LINGER_S if has_all else STALLED_S
        is_moving = now_s - max(self.progress_s, ended_s) < patience_s
        return is_moving and now_s - self.heard_s < max(patience_s, PEER_GONE_S)

    def send(self, packet: bytes) -> None:
        """Take the next packet of the call.  Raises `ProtocolError` if it is invalid."""
        self._has_ended = self._has_ended or is_end(packet)
        if packet_kind(packet) is not PacketKind.FRAME:
            first = self._items.add(packet, self._frames)
            if packet_kind(packet) is PacketKind.MODEL and not self._lossless:
                self._update = first if self._has_model else None
                self._has_model, self._held_s = True, None
            return
        # Numbers that the encoder leaves out, while no face is there, are left out here as well.
        self._frames += (packet[0] - self._frames) % SEQUENCE_MODULUS
        if self._lossless:
            self._items.add(packet, self._frames)
        else:
            self._frames_due.append((self._frames, packet))
        self._frames += 1

    def receive(self, data: bytes, now_s: float) -> None:
        """Take a payload of a decoder.  Raises `ProtocolError` if it is invalid."""
        message = parse_message(data)
        if isinstance(message, Hello):
            self._on_hello(message, now_s)
        elif isinstance(message, Report):
            self._on_report(message, now_s)
        elif isinstance(message, Bye):
            self._on_bye(message)

    def on_new_link(self) -> None:
        """Another connection is in use: who is there is asked again at once."""
        self._asked_s, self._asks = float("-inf"), 0

    def forget_peers(self) -> None:
        """The link is broken: who is still there has to say so."""
        self._peers.clear()

    def hello(self, now_s: float, asks: bool = True) -> bytes:
        """A HELLO to all."""
        return self._hello(now_s, NO_SESSION, asks)

    def payloads(self, now_s: float) -> list[bytes]:
        """What is to be sent now."""
        gone = [peer for peer in self._peers.values() if now_s - peer.heard_s > PEER_GONE_S]
        for peer in gone:
            del self._peers[peer_id(peer.session)]
        if gone:
            self._pieces.forget_sent(list(self._peers.values()))
        present = [
            peer
            for peer in self._peers.values()
            if peer.has_reported and now_s - peer.heard_s < PEER_SILENT_S
        ]
        out, self._out = self._out, []
        out += self._released_frames(present, now_s)
        out += self._copies.due(now_s, self._frames)
        out += self._questions(now_s)
        return out + [serialise_message(piece) for piece in self._pieces.due(present, now_s)]

    def bye(self) -> bytes:
        """What is sent at last."""
        return serialise_message(Bye(Role.ENCODER, peer_id(self._session)))

    def _released_frames(self, present: list[Peer], now_s: float) -> Iterator[bytes]:
        """The frame packets to send; those of an update once it is there, within a limit."""
        while self._frames_due:
            number, packet = self._frames_due[0]
            update = self._update
            if update is not None and number >= update.first:
                lacking = any(peer.lacks(key) for peer in present for key in update.pieces)
                self._held_s = now_s if self._held_s is None else self._held_s
                if lacking and now_s - self._held_s < UPDATE_PATIENCE_S:
                    return
                self._update = None
            self._frames_due.popleft()
            self._items.on_frame(packet)
            self._history.append((number, packet))
            if number < EARLY_FRAMES and (self.quality.rate_bps or 0.0) > SURE_BPS:
                self._copies.add(now_s + AGAIN_S, number, packet)
            yield packet

    def _questions(self, now_s: float) -> Iterator[bytes]:
        peers = self._peers.values()
        if now_s - self._asked_s >= ASK_S and self._is_to_ask(now_s):
            self._asked_s, self._asks = now_s, self._asks + 1
            yield self.hello(now_s)
        for peer in filter(_is_to_probe, peers if len(peers) <= PROBED_PEERS else ()):
            window = peer.window
            pause_s = ASK_S
            if window.padded_trips < peer.probes:
                pause_s = min(max(2.5 * (window.round_trip_s or 0.0), ASK_S), LATER_ASK_S)
            if now_s - peer.probed_s > pause_s:
                peer.probed_s, peer.probes = now_s, peer.probes + 1
                # One after the other, so that the link takes longer for the second alone.
                yield self._hello(now_s, peer.session, asks=True)
                yield self._hello(now_s, peer.session, asks=True, padding=PADDING_BYTES)

    def _is_to_ask(self, now_s: float) -> bool:
        """Whether all decoders are asked now, the last question being `ASK_S` ago."""
        peers, is_late = self._peers.values(), now_s - self._asked_s >= LATER_ASK_S
        if not peers:
            return is_late or self._asks < FIRST_ASKS
        if now_s - self._asked_s < len(peers) / ANSWERS_PER_S:
            return False
        if any(not peer.has_reported for peer in peers):
            return True
        return is_late and any(
            now_s - peer.heard_s > PEER_SILENT_S or self._pieces.is_behind(peer) for peer in peers
        )

    def _hello(
        self, now_s: float, echo: bytes, asks: bool, answers: int = 0, padding: int = 0
    ) -> bytes:
        self._nonce = self._nonce % (NONCES - 1) + 1
        self._nonces[self._nonce] = now_s, padding
        return serialise_message(
            Hello(
                role=Role.ENCODER,
                session=self._session,
                echo=echo,
                asks=asks,
                nonce=self._nonce,
                answers=answers,
                frames=self._frames_due[0][0] if self._frames_due else self._frames,
                ordered=self._items.span(Channel.ORDERED),
                unordered=self._items.span(Channel.UNORDERED),
                padding=padding,
            )
        )

    def _on_hello(self, hello: Hello, now_s: float) -> None:
        if hello.role is not Role.DECODER:
            return
        if hello.is_busy and hello.echo != self._session:
            self._busy_s = now_s
            return
        if self._gone.get(peer_id(hello.session)) == hello.session:
            # It was sent before the good-bye.
            return
        peer = self._peers.get(peer_id(hello.session))
        if hello.echo == self._session:
            if peer is None:
                peer = self._peers[peer_id(hello.session)] = Peer(
                    hello.session, now_s, window=PieceWindow(self._rate_bps)
                )
                self._on_peer(hello.session)
            elif hello.session not in {peer.session, *peer.others}:
                peer.others.add(hello.session)
                self._on_peer(hello.session)
            peer.heard_s = self.heard_s = now_s
            self._measure(peer, hello.answers, now_s)
        if hello.asks and (peer is None or now_s - peer.answered_s >= ANSWER_S):
            if peer is not None:
                peer.answered_s = now_s
            known = peer is not None and peer.window.round_trip_s is not None
            self._out.append(self._hello(now_s, hello.session, not known, hello.nonce))

    def _on_bye(self, bye: Bye) -> None:
        peer = self._peers.pop(bye.peer, None) if bye.role is Role.DECODER else None
        if peer is not None:
            self._pieces.forget_sent(list(self._peers.values()))
            if not peer.others:
                self._gone[bye.peer] = peer.session
            self.is_end_heard = self.is_end_heard or self._has_ended
            if not self._peers:
                self.heard_s = float("-inf")

    def _measure(self, peer: Peer, answered: int, now_s: float) -> None:
        sent_s, padding = self._nonces.get(answered, (None, 0))
        if sent_s is None:
            return
        if not padding:
            peer.window.on_round_trip(now_s - sent_s)
            peer.answered = answered, now_s
        elif peer.answered[0] == _before(answered):
            peer.window.on_padding(now_s - peer.answered[1], padding)

    def _on_report(self, report: Report, now_s: float) -> None:
        peer = self._peers.get(report.peer)
        if peer is None:
            # Known after its next HELLO.
            self._asked_s = min(self._asked_s, now_s - ASK_S)
            return
        peer.heard_s = self.heard_s = now_s
        peer.loss, peer.has_reported = report.loss / 255, True
        if self._pieces.acknowledge(peer, report, list(self._peers.values()), now_s):
            self.progress_s = now_s
        if self._has_ended and not any(self._pieces.needed([peer])):
            self.is_end_heard = True
        for number, packet in self._history:
            recently = now_s - self._repeated_s.get(number, float("-inf")) < REPEAT_S
            if number in report.missing and not recently:
                self._repeated_s[number] = now_s
                self._out.append(packet)
                for copy in range(1, COPIES if peer.loss > LOSSY else 1):
                    self._copies.add(now_s + AGAIN_S * copy, number, packet)
        oldest = self._frames - HISTORY
        self._repeated_s = {n: at for n, at in self._repeated_s.items() if n >= oldest}


def _is_to_probe(peer: Peer) -> bool:
    """Whether what its link carries is unknown, and may be found out."""
    window = peer.window
    is_answering = window.round_trip_s is not None
    return is_answering and not window.is_measured and peer.probes < MAX_PROBES


def _before(nonce: int) -> int:
    """The nonce of the message before."""
    return (nonce - 2) % (NONCES - 1) + 1


class FrameCopies:
    """Copies that wait for their time."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, bytes]] = []

    def add(self, due_s: float, number: int, packet: bytes) -> None:
        """Send a copy of frame packet `number` at a time."""
        self._waiting.append((due_s, number, packet))

    def due(self, now_s: float, next_number: int) -> Iterator[bytes]:
        """Those whose time has come, but for those too far behind."""
        for due_s, number, packet in self._waiting:
            if due_s <= now_s and next_number - number <= MAX_BEHIND:
                yield packet
        self._waiting = [each for each in self._waiting if each[0] > now_s]
