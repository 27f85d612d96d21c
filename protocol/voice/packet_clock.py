"""When the speech of a frame packet is spoken: from the numbers of packets to speech frames.

Speech frame k of a call begins k / 25 s after its source frame 0.  The speech frames of a packet
begin with the first one at or after the packet's first picture, unless the packet says by how many
it is displaced.  Both ends follow the numbers of packets as docs/format.md specifies.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from protocol.call_parameters import CallParameters
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ
from protocol.limits import FIRST_WINDOW, LATE_WINDOW, SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND


@dataclass(frozen=True, slots=True)
class _Model:
    """The parameters of a model, and the number of its first frame packet in the call."""

    call: CallParameters
    version: int
    first: int

    def last_frame(self, number: int) -> Fraction:
        """Time of the newest face of packet `number` of the call, in source frames."""
        spacing = Fraction(self.call.frame_step * self.call.frames_per_packet)
        if self.call.profile == "thesis":
            spacing = Fraction(self.call.fps_numerator, self.call.fps_denominator) / THESIS_RATE_HZ
        return self.call.start_frame + (number - self.first) * spacing

    def first_frame(self, number: int) -> Fraction:
        """Time of the first picture that packet `number` shows, in source frames."""
        if number == self.first:
            return Fraction(self.call.start_frame)
        return self.last_frame(number - 1) + 1


class PacketClock:
    """Follows the models and the frame packets of a call with a voice, on either side."""

    def __init__(self) -> None:
        self._models: list[_Model] = []  # in use, the newest last; one before it for late packets
        self._update: _Model | None = None
        self._newest = -1
        self._has_frames = self._joined_late = False

    @property
    def voice(self) -> str:
        """The codec of the call's voice; "off" before a model packet, or if it has no voice."""
        return self._models[-1].call.voice if self._models else "off"

    @property
    def newest(self) -> int:
        """Number of the newest frame packet; before the first has come, its number less one."""
        return self._newest

    @property
    def call(self) -> CallParameters | None:
        """Parameters of the call; None before a model packet."""
        return self._models[-1].call if self._models else None

    def add_model(self, packet: ModelPacket, number: int | None = None) -> None:
        """Enter a model packet: the first one, an update, or a repetition of one.

        number: of the first frame packet coded by it; None: as far as its 6 bits tell.
        """
        newest = self._update or (self._models[-1] if self._models else None)
        if newest is None:
            first = packet.sequence if number is None else number
            self._models, self._newest = [_Model(packet.call, packet.version, first)], first - 1
            self._joined_late = packet.version > 0
        elif packet.version > newest.version:
            ahead = (packet.sequence - self._newest) % SEQUENCE_MODULUS
            first = self._newest + ahead if number is None else number
            self._update = _Model(packet.call, packet.version, first)

    def add_packet(self, sequence: int, number: int | None = None) -> int:
        """The number in the call of a frame packet, which may be late; needs a model packet.

        number: as the link knows it; None: as far as the 6 bits of `sequence` tell.
        """
        if number is None:
            ahead = (sequence - self._newest) % SEQUENCE_MODULUS
            if self._has_frames and ahead >= SEQUENCE_MODULUS - LATE_WINDOW:
                ahead -= SEQUENCE_MODULUS
            number = self._newest + ahead
        if number > self._newest:
            is_late = not self._has_frames and number > self._newest + FIRST_WINDOW
            self._joined_late |= is_late
            self._newest, self._has_frames = number, True
        if self._update is not None and number >= self._update.first:
            self._models = [self._models[-1], self._update]
            self._update = None
        return number

    def resume(self, frame: int) -> None:
        """Skip the numbers of packets before source frame `frame`, where a face is found again."""
        if self._models and not self._joined_late:
            self._newest = max(self._newest, self._number_at(frame) - 1)

    def expected(self, number: int) -> int:
        """The speech frame with which packet `number` of the call begins if it says nothing."""
        return self.speech_frame(self._of(number).first_frame(number))

    def end(self, number: int) -> int:
        """The speech frame after those of packet `number`, where all its pictures are shown."""
        return self.speech_frame(self._of(number).last_frame(number) + 1)

    def speech_frame(self, frame: int | Fraction) -> int:
        """The first speech frame that begins at or after a time in source frames."""
        call = self._models[-1].call
        per_frame = Fraction(SPEECH_FRAMES_PER_SECOND * call.fps_denominator, call.fps_numerator)
        return ceil(frame * per_frame)

    def join(self, frame: int) -> None:
        """Take source frame `frame` for the first one of the packet that follows."""
        if self._models and not self._has_frames:
            self._joined_late, self._newest = False, self._number_at(frame) - 1

    def begins_call(self, number: int) -> bool:
        """Whether packet `number` is the first of the call."""
        model = self._of(number)
        return not model.version and number == model.first

    def first_frame(self, number: int) -> int:
        """The first source frame that packet `number` shows."""
        return ceil(self._of(number).first_frame(number))

    def end_frame(self, number: int) -> int:
        """The source frame after those of packet `number`, where all its pictures are shown."""
        return floor(self._of(number).last_frame(number)) + 1

    def packets_until(self, frame: int) -> range:
        """Numbers of coming packets whose last face is at or before source frame `frame`."""
        end = self._newest + 1
        while self._of(end).last_frame(end) <= frame:
            end += 1
        return range(self._newest + 1, end)

    def _of(self, number: int) -> _Model:
        """The model of packet `number`."""
        if self._update is not None and number >= self._update.first:
            return self._update
        model = self._models[-1]
        return model if number >= model.first else self._models[0]

    def _number_at(self, frame: int) -> int:
        """The packet of the first coded face at or after source frame `frame`."""
        model = self._models[-1]
        spacing = model.last_frame(1) - model.last_frame(0)
        return model.first + max(0, ceil((frame - model.call.start_frame) / spacing))
