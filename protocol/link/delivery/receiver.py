"""What the decoder's end of a link does, without input and output.

Puts items together from their pieces, gives each frame packet its full number, drops what comes
twice, asks for what is missing and reports what has come.  Time is an argument.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from protocol.errors import ProtocolError
from protocol.link.delivery.frame_numbers import FrameNumbers
from protocol.link.delivery.item_assembly import ItemAssembly
from protocol.link.interface import Arrival
from protocol.link.messages import (
    NO_SESSION,
    NONCES,
    Bye,
    Channel,
    Hello,
    Piece,
    Report,
    Role,
    is_message,
    parse_message,
    peer_id,
    serialise_message,
)
from protocol.packets import PacketKind, is_end, packet_kind

# How often a report goes out when nothing is new, and at most.  Zenoh sends a message of its own
# after 5 s without one.
REPORT_S, MIN_REPORT_S = 3.0, 0.02
# How late at most a piece is reported that was there already: a report has been lost, or the piece
# is for another decoder.  Each one that follows on such a piece waits twice as long.
MAX_REPEAT_S = 1.28
# How often an encoder is asked that has never answered, first and later.
ASK_S, LATER_ASK_S, FIRST_ASKS = 0.25, 1.0, 20
# After what silence an encoder is asked that sends frames, and one that does not.
SILENT_S, IDLE_S = 0.8, 2.0
# After what silence another encoder may take the call over.
ENCODER_GONE_S = 2.5
# A call that has had a frame packet within this time is on its way.
ACTIVE_S = 5.0
# Frame packets that wait for the model, and for a HELLO that tells their numbers.
MAX_WAITING_FRAMES, MAX_UNNUMBERED = 256, 64
# How long the END waits for frame packets before it that have been asked for.
END_PATIENCE_S = 2.5
# How long it waits for a model after the last piece that came.
MODEL_PATIENCE_S = 6.0

PeerCallback = Callable[[bytes], None]


@dataclass(slots=True)
class _Call:
    """What has come of one session of the encoder.

    index: of the session, see `Arrival.session`.  piece_s: when a piece of an item came last.
    is_over: the END has been given out.
    """

    session: bytes
    index: int
    heard_s: float
    frames: FrameNumbers
    items: ItemAssembly = field(default_factory=ItemAssembly)
    has_model: bool = False
    waiting: deque[Arrival] = field(default_factory=lambda: deque(maxlen=MAX_WAITING_FRAMES))
    unnumbered: deque[tuple[bytes, float]] = field(
        default_factory=lambda: deque(maxlen=MAX_UNNUMBERED)
    )
    end: tuple[Arrival, float] | None = None
    piece_s: float = float("-inf")
    left: bool = False
    is_over: bool = False


class DeliveryReceiver:
    """Receives one call, whichever encoder sends it.

    session: of this start of the decoder.
    on_peer: called with the session of an encoder that has echoed ours.
    is_reliable: nothing is lost on the way, packets only come late.
    repeats_frames: the encoder sends frame packets until they are there.
    """

    def __init__(self, session: bytes, on_peer: PeerCallback, is_reliable: bool = False) -> None:
        self._session, self._on_peer, self.is_reliable = session, on_peer, is_reliable
        self.repeats_frames = False
        self._call: _Call | None = None
        self._out: list[bytes] = []
        self._nonce = 0
        self._asked_s, self._asks = float("-inf"), 0
        self._answered_s = float("-inf")
        self._reported_s, self._report_due_s = float("-inf"), float("inf")
        self._repeat_s = MIN_REPORT_S
        self._sessions = 0
        self._sent_s: dict[int, float] = {}  # when a question was sent, by its nonce
        self._round_trip_s = float("inf")

    @property
    def heard_s(self) -> float | None:
        """When the encoder was heard last; None: never."""
        return self._call.heard_s if self._call else None

    @property
    def has_left(self) -> bool:
        """Whether the encoder has said that it leaves."""
        return self._call is not None and self._call.left

    def on_new_link(self) -> None:
        """Another connection is in use: the encoder is asked again at once."""
        self._asked_s, self._asks = float("-inf"), 0

    def is_active(self, now_s: float) -> bool:
        """Whether frame packets are coming."""
        call = self._call
        return call is not None and now_s - call.frames.newest_s < ACTIVE_S

    def hello(self, now_s: float) -> bytes:
        """A HELLO that asks for an answer."""
        question = self._hello(asks=True)
        self._sent_s[self._nonce] = now_s
        return question

    def bye(self) -> bytes | None:
        """What is sent at last; None if there is no encoder."""
        return self._bye() if self._call else None

    def receive(self, data: bytes, now_s: float) -> list[Arrival]:
        """The packets that are complete by a payload.  Raises `ProtocolError` if it is invalid."""
        call = self._call
        if is_message(data):
            message = parse_message(data)
            if isinstance(message, Hello):
                return self._on_hello(message, now_s)
            if call is not None and isinstance(message, Piece):
                call.heard_s = now_s
                return self._on_piece(call, message, now_s)
            if call is not None and isinstance(message, Bye):
                call.left = message.role is Role.ENCODER
            return []
        if packet_kind(data) is not PacketKind.FRAME:
            raise ProtocolError("neither a frame packet nor a message of the link")
        if call is None:
            return []
        silent_s, call.heard_s = now_s - call.heard_s, now_s
        if silent_s > call.frames.certain_s:
            call.frames.is_certain = False
        return self._on_frame(call, data, now_s)

    def due(self, now_s: float) -> list[Arrival]:
        """The packets that need not wait any longer."""
        call = self._call
        if call is None or call.end is None:
            return []
        arrival, since_s = call.end
        if call.frames.awaits_below(arrival.number or 0) and now_s - since_s < END_PATIENCE_S:
            return []
        if not call.has_model and now_s - call.piece_s < MODEL_PATIENCE_S:
            return []
        call.end, call.is_over = None, True
        self._out.append(self._bye())
        return [*call.waiting, arrival]

    def payloads(self, now_s: float) -> list[bytes]:
        """What is to be sent now."""
        out, self._out = self._out, []
        call = self._call
        if call is not None and call.is_over:
            return out
        out += self._questions(call, now_s)
        if call is None:
            return out
        missing = call.frames.to_ask(now_s, self.is_reliable)
        if missing or now_s >= min(self._report_due_s, self._reported_s + REPORT_S):
            self._reported_s, self._report_due_s = now_s, float("inf")
            out.append(self._report(call, missing))
        return out

    def _questions(self, call: _Call | None, now_s: float) -> Iterator[bytes]:
        if call is None:
            pause_s = ASK_S if self._asks < FIRST_ASKS else LATER_ASK_S
        elif not call.frames.is_certain:
            pause_s = ASK_S
        else:
            silence_s = SILENT_S if self.is_active(now_s) else IDLE_S
            if now_s - call.heard_s < silence_s:
                return
            pause_s = silence_s / 2
        if now_s - self._asked_s >= pause_s:
            self._asked_s, self._asks = now_s, self._asks + 1
            yield self.hello(now_s)

    def _hello(self, asks: bool, answers: int = 0, is_busy: bool = False) -> bytes:
        self._nonce = self._nonce % (NONCES - 1) + 1
        echo = self._call.session if self._call else NO_SESSION
        return serialise_message(
            Hello(Role.DECODER, self._session, echo, asks, is_busy, self._nonce, answers)
        )

    def _bye(self) -> bytes:
        return serialise_message(Bye(Role.DECODER, peer_id(self._session)))

    def _on_hello(self, hello: Hello, now_s: float) -> list[Arrival]:
        if hello.role is not Role.ENCODER:
            return []
        call = self._call
        if call is None or hello.session != call.session:
            self._on_other_session(hello, now_s)
            call = self._call
            if call is None or hello.session != call.session:
                return []
        call.heard_s = now_s
        if (sent_s := self._sent_s.pop(hello.answers, None)) is not None:
            self._round_trip_s = min(self._round_trip_s, now_s - sent_s)
            call.frames.learn_round_trip(self._round_trip_s)
        if call.is_over:
            self._out.append(self._bye())
            return []
        call.items.extend(Channel.ORDERED, hello.ordered)
        call.items.extend(Channel.UNORDERED, hello.unordered)
        call.frames.synchronise(hello.frames, now_s)
        is_asked = hello.asks and self._is_meant(hello)
        if is_asked and (hello.padding or now_s - self._answered_s >= MIN_REPORT_S):
            self._answered_s = now_s
            self._out.append(self._hello(asks=False, answers=hello.nonce))
            self._report_due_s = now_s
        numbered, call.unnumbered = call.unnumbered, deque(maxlen=MAX_UNNUMBERED)
        return [arrival for data, at_s in numbered for arrival in self._on_frame(call, data, at_s)]

    def _is_meant(self, hello: Hello) -> bool:
        """Whether `hello` is for this decoder: all decoders of a call hear what is said to one."""
        return hello.echo in (NO_SESSION, self._session)

    def _on_other_session(self, hello: Hello, now_s: float) -> None:
        """An encoder that is new, or another one."""
        call = self._call
        if not self._is_meant(hello):
            return
        if call is not None and not call.left and now_s - call.heard_s < ENCODER_GONE_S:
            self._out.append(self._hello(asks=False, answers=hello.nonce, is_busy=True))
        elif hello.echo != self._session:
            # Its answer to this shows that it is no recording of an earlier one.
            self._out.append(self._hello(asks=True, answers=hello.nonce))
            self._sent_s[self._nonce] = now_s
        else:
            frames = FrameNumbers(hello.frames)
            self._call = _Call(hello.session, self._sessions, now_s, frames)
            self._sessions += 1
            self._on_peer(hello.session)
            self._call.items.begin(Channel.ORDERED, hello.ordered)
            self._call.items.begin(Channel.UNORDERED, hello.unordered)
            self._report_due_s = now_s

    def _on_piece(self, call: _Call, piece: Piece, now_s: float) -> list[Arrival]:
        is_known = call.items.has(piece)
        complete, call.piece_s = call.items.add(piece), now_s
        self._repeat_s = min(2 * self._repeat_s, MAX_REPEAT_S) if is_known else MIN_REPORT_S
        self._report_due_s = min(self._report_due_s, max(now_s, self._reported_s + self._repeat_s))
        found = list[Arrival]()
        for number, packet in complete:
            kind = packet_kind(packet)
            known = None if kind is PacketKind.LAYER else number
            arrival = Arrival(packet, now_s, call.index, known)
            if kind is PacketKind.FRAME:
                self.repeats_frames = True
                call.frames.pass_by(number, now_s)
            if is_end(packet):
                call.frames.synchronise(number, now_s)
                call.end = arrival, now_s
                continue
            found.append(arrival)
            if kind is PacketKind.MODEL and not call.has_model:
                call.has_model = True
                call.frames.begin(now_s)
                found += call.waiting
                call.waiting.clear()
        return found

    def _on_frame(self, call: _Call, data: bytes, at_s: float) -> list[Arrival]:
        if not call.frames.is_certain:
            call.unnumbered.append((data, at_s))
            return []
        number = call.frames.take(data[0], at_s)
        if number is None:
            return []
        arrival = Arrival(data, at_s, call.index, number)
        if call.has_model:
            return [arrival]
        call.waiting.append(arrival)
        return []

    def _report(self, call: _Call, missing: tuple[int, ...]) -> bytes:
        return serialise_message(
            Report(
                peer=peer_id(self._session),
                loss=round(255 * call.frames.loss),
                frames=call.frames.newest + 1,
                ordered=call.items.below(Channel.ORDERED),
                unordered=call.items.below(Channel.UNORDERED),
                holdings=call.items.holdings(),
                missing=missing,
            )
        )
