"""What is received of one start of an encoder: its packets in order, with the times to wait."""

from collections import deque

from decoder.playout.arrival_clock import MAX_WAIT_S, ArrivalClock
from decoder.playout.jitter_buffer import MAX_HELD, JitterBuffer, NumberedPacket
from decoder.playout.playout import Playout, PlayoutFrame
from decoder.sound.voice_separator import VoiceSeparator
from protocol.errors import ProtocolError
from protocol.limits import FIRST_WINDOW, SEQUENCE_MODULUS
from protocol.link.interface import Arrival
from protocol.packets import ControlPacket, FramePacket, Packet

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
        self.voice, self._buffer = VoiceSeparator(), JitterBuffer(self._deadline_s)
        self.offset: int | None = None
        self._newest = -1
        self._heard_s = 0.0  # when the newest frame packet arrived
        self._at_once: deque[tuple[Packet, int | None]] = deque()  # packets without an order
        self._early: deque[NumberedPacket] = deque()  # packets that wait for the model

    @property
    def release_s(self) -> float | None:
        """When a packet's turn comes if none arrives before; None: not known."""
        return self._buffer.release_s

    def enter(self, packet: Packet, arrival: Arrival) -> None:
        """Enter a packet as it arrives."""
        if arrival.number is None or not isinstance(packet, FramePacket | ControlPacket):
            self._at_once.append((packet, arrival.number))
        elif len(self._early) < MAX_HELD:
            self._early.append(NumberedPacket(arrival.number, packet, arrival.time_s))

    def is_ready(self, now_s: float) -> bool:
        """Whether it is a packet's turn at `now_s`."""
        if self._at_once or (self._early and self.playout.model is not None):
            return True
        return self._buffer.is_ready(now_s)

    def take(self, now_s: float) -> list[PlayoutFrame]:
        """The frames of the packet whose turn it is; none where it is no packet's turn.

        Raises `ProtocolError` if that packet is damaged or contradicts the call.
        """
        if self._at_once:
            packet, number = self._at_once.popleft()
            face = self.voice.receive(packet, number)
            return [] if face is None else self.playout.receive(face, number)
        while self._early and self.playout.model is not None:
            self._put_in_order(self._early.popleft())
        if not self._buffer.is_ready(now_s):
            return []
        item = self._buffer.take()
        if item.packet is None:
            return []
        try:
            return self.playout.receive(item.packet, item.number)
        finally:
            self._buffer.is_idle = self.playout.is_frozen

    def frame_due(self, now_s: float) -> int | None:
        """The source frame that a silence since the newest packet has reached; None: not known.

        An encoder slower than its source is not silent as long as packets come.
        """
        model = self.playout.model
        silent_s = now_s - self._heard_s - SILENCE_S
        if model is None or self._newest < 0 or silent_s <= 0:
            return None
        return int((self.playout.time_s(self._newest) + silent_s) * model.call.fps)

    def _put_in_order(self, item: NumberedPacket) -> None:
        """Enter a packet with a number, once there is a model."""
        packet = item.packet
        assert packet is not None
        if isinstance(packet, FramePacket):
            self._note(item.number, packet, item.arrival_s)
        elif self._buffer.next is None:
            self._buffer.start(item.number)
        face = self.voice.receive(packet, item.number)
        assert face is None or isinstance(face, FramePacket | ControlPacket)
        self._buffer.add(NumberedPacket(item.number, face, item.arrival_s))

    def _note(self, number: int, packet: FramePacket, arrival_s: float) -> None:
        if number % SEQUENCE_MODULUS != packet.sequence:
            raise ProtocolError(f"frame packet {number} has sequence number {packet.sequence}")
        self.clock.note(self.playout.time_s(number), arrival_s, number < self._newest)
        if number > self._newest:
            self._newest, self._heard_s = number, arrival_s
        if self._buffer.next is None:
            first = self.playout.next_number
            self._buffer.start(first if first <= number <= first + FIRST_WINDOW else number)

    def _deadline_s(self, number: int) -> float:
        expected_s = self.clock.expected_s(self.playout.time_s(number))
        return expected_s + self.clock.wait_s
