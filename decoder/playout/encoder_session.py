"""What is received of one start of an encoder: its packets in order, with the times to wait."""

from collections import deque
from collections.abc import Iterator

from decoder.playout.arrival_clock import MAX_WAIT_S, ArrivalClock
from decoder.playout.jitter_buffer import MAX_HELD, JitterBuffer, NumberedPacket
from decoder.playout.playout import Playout, PlayoutFrame
from decoder.sound.voice_separator import VoiceSeparator
from protocol.errors import ProtocolError
from protocol.limits import FIRST_WINDOW, SEQUENCE_MODULUS
from protocol.link.interface import Arrival
from protocol.packets import ControlPacket, FramePacket, Packet, parse_packet

# After so long a silence the last face is shown for the frames that do not come.  What comes within
# that time, of a link that was away or of a slow encoder, is shown late but whole.
SILENCE_S = 30.0


class EncoderSession:
    """The packets of one start of the encoder.

    voice: takes the speech out of them.
    offset: index of its source frame 0 in the call; None before its first picture is shown.
    """

    def __init__(self, max_wait_s: float = MAX_WAIT_S) -> None:
        self.playout, self.clock = Playout(), ArrivalClock(max_wait_s)
        self.voice, self.buffer = VoiceSeparator(), JitterBuffer(self._deadline_s)
        self.offset: int | None = None
        self._newest = -1
        self._heard_s = 0.0  # when the newest frame packet arrived
        self._early: deque[Arrival] = deque()  # packets that wait for the model

    def receive(self, arrival: Arrival) -> Iterator[PlayoutFrame]:
        """The frames of this session that can be shown after an arrival.

        Raises `ProtocolError` as `Playout.receive`.
        """
        packet = parse_packet(arrival.data)
        is_ordered = isinstance(packet, FramePacket | ControlPacket)
        if arrival.number is None or not is_ordered:
            yield from self._receive(self.voice.receive(packet, arrival.number), arrival.number)
        elif len(self._early) < MAX_HELD:
            self._early.append(arrival)
        while self._early and self.playout.model is not None:
            yield from self._receive_ordered(self._early.popleft())

    def poll(self, now_s: float) -> Iterator[PlayoutFrame]:
        """The frames that can be shown at `now_s`.  Raises `ProtocolError`."""
        while item := self.buffer.take(now_s):
            yield from self._receive(item.packet, item.number)
            self.buffer.is_idle = self.playout.is_frozen

    def frame_due(self, now_s: float) -> int | None:
        """The source frame that a silence since the newest packet has reached; None: not known.

        An encoder slower than its source is not silent as long as packets come.
        """
        model = self.playout.model
        silent_s = now_s - self._heard_s - SILENCE_S
        if model is None or self._newest < 0 or silent_s <= 0:
            return None
        return int((self.playout.time_s(self._newest) + silent_s) * model.call.fps)

    def _receive(self, packet: Packet | None, number: int | None) -> Iterator[PlayoutFrame]:
        """As `receive`, of what comes next; None: of a packet without a face."""
        if packet is not None:
            yield from self.playout.receive_packet(packet, number)

    def _receive_ordered(self, arrival: Arrival) -> Iterator[PlayoutFrame]:
        """As `receive`, of a packet with a number, once there is a model."""
        packet, number = parse_packet(arrival.data), arrival.number
        assert isinstance(packet, FramePacket | ControlPacket) and number is not None
        if isinstance(packet, FramePacket):
            self._note(number, packet, arrival.time_s)
        elif self.buffer.next is None:
            self.buffer.start(number)
        face = self.voice.receive(packet, number)
        assert face is None or isinstance(face, FramePacket | ControlPacket)
        self.buffer.add(NumberedPacket(number, face, arrival.time_s))
        yield from self.poll(arrival.time_s)

    def _note(self, number: int, packet: FramePacket, arrival_s: float) -> None:
        if number % SEQUENCE_MODULUS != packet.sequence:
            raise ProtocolError(f"frame packet {number} has sequence number {packet.sequence}")
        self.clock.note(self.playout.time_s(number), arrival_s, number < self._newest)
        if number > self._newest:
            self._newest, self._heard_s = number, arrival_s
        if self.buffer.next is None:
            first = self.playout.next_number
            self.buffer.start(first if first <= number <= first + FIRST_WINDOW else number)

    def _deadline_s(self, number: int) -> float:
        expected_s = self.clock.expected_s(self.playout.time_s(number))
        return expected_s + self.clock.wait_s
