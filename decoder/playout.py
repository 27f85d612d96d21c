"""The play-out buffer: from packets in any order of arrival to one face per source frame.

Coded faces are less frequent than source frames; the faces between two coded ones are interpolated,
also across lost packets.  Before the first coded face and after the last, the nearest one is
repeated; while the encoder has lost the face, its last one is repeated (a frozen face).  A live
call is therefore delayed by the time between two coded faces.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

import numpy as np

from decoder.frame_decoder import FrameDecoder, TimedFace, frame_decoder_for
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.frame_times import FrameClock, TimesPacket
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    parse_packet,
)
from protocol.progressive_model import LayerBuffer
from shared_model.geometry import interpolate
from shared_model.parameters import FaceParameters, with_focal_change

# A packet up to so many sequence numbers behind the newest is late; any other is ahead of it.
LATE_WINDOW = 16
# A first frame packet with a higher number shows that the call was joined late.
FIRST_WINDOW = 9
# A packet may be at most so far ahead of the last frame (ten minutes).
MAX_FROZEN_S = 600


@dataclass(frozen=True, slots=True)
class PlayoutFrame:
    """The face of source frame `index`; `frozen`: the encoder had no face there."""

    index: int
    face: FaceParameters
    frozen: bool


class Playout:
    """Turns the packets of one call into the faces of its source frames, in order.

    model: the model of the newest frames, None before a model packet.  An update is activated by
        the frame packet with its sequence number.  The layers received are applied.
    clock: when source frames are shown.
    ended: the END packet has been received.
    lost, late, unusable: numbers of frame packets that are missing, that were received too late or
        repeated, and that preceded the model packet.
    """

    def __init__(self) -> None:
        self.model: ModelPacket | None = None
        self.clock = FrameClock()
        self.ended = False
        self.joined_late = False
        self.lost = self.late = self.unusable = 0
        self._next = 0
        self._newest = -1  # number of the newest frame packet
        self._last: TimedFace | None = None
        self._decoder: FrameDecoder | None = None
        self._first = 0  # number of the model's first frame packet
        self._update: tuple[ModelPacket, FrameDecoder, int] | None = None
        self._layers = LayerBuffer()
        self._face_lost = False

    @property
    def next_frame(self) -> int:
        """The source frame to show next; less than 0 before it is known."""
        return self._next

    def receive(self, data: bytes) -> Iterator[PlayoutFrame]:
        """The frames that can be shown after the packet `data`, perhaps none.

        The packet takes effect as the iterator is consumed.
        Raises `ProtocolError` if the packet is damaged or contradicts the call.
        """
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            self._receive_model(packet)
        elif isinstance(packet, LayerPacket):
            self._receive_layer(packet)
        elif isinstance(packet, TimesPacket):
            self.clock.receive(packet)
        elif self.model is None or self._decoder is None:
            self.unusable += 1
        elif isinstance(packet, FramePacket):
            yield from self._receive_frame(packet)
        else:
            yield from self._receive_control(self.model.call, packet)

    def _receive_model(self, packet: ModelPacket) -> None:
        """Enter the first model packet or an update; either may be repeated for a late joiner."""
        newest = self._update[0] if self._update else self.model
        if newest is None:
            self.model, self._decoder = packet, frame_decoder_for(packet)
            self._first, self._newest = packet.sequence, packet.sequence - 1
            if packet.version:
                self._join_late()
            self.model = self._layers.apply(packet)
        elif packet.version > newest.version:
            check_update(newest.call, packet.call)
            ahead = (packet.sequence - self._newest) % SEQUENCE_MODULUS
            self._update = packet, frame_decoder_for(packet), self._newest + ahead
            self._apply_layers_to_update()
        elif self.model is not None and self.model.with_missing_pictures_from(packet) != self.model:
            # A decoder that joined at an update receives the pictures before it later.
            check_update(self.model.call, packet.call)
            self.model = self.model.with_missing_pictures_from(packet)

    def _receive_layer(self, packet: LayerPacket) -> None:
        """Enter a layer; a late joiner may receive it before its model."""
        if self.model is None or packet.model_version >= self.model.version:
            self._layers.add(packet)
        if self.model is not None and packet.model_version == self.model.version:
            self.model = self._layers.apply(self.model)
        elif self._update is not None and packet.model_version == self._update[0].version:
            self._apply_layers_to_update()

    def _apply_layers_to_update(self) -> None:
        """Apply layers before the update is activated, lest damage affect its first frame."""
        assert self._update is not None
        model, decoder, first = self._update
        self._update = self._layers.apply(model), decoder, first

    def _receive_frame(self, packet: FramePacket) -> Iterator[PlayoutFrame]:
        number = self._extend_sequence_number(packet.sequence)
        if number is None:
            self.late += 1
            return
        if self._update is not None and number >= self._update[2]:
            self._activate_update(*self._update)
        assert self.model is not None and self._decoder is not None
        call = self.model.call
        coded = self._decoder.decode(number - self._first, packet.payload)
        self.lost += number - self._newest - 1
        self._newest = number
        for timed in coded:
            yield from self._frames_until(call, timed)
            frozen = self._face_lost and self._last is not None
            face = self._last.face if frozen and self._last else timed.face
            self._last = TimedFace(timed.timestamp, face)

    def _activate_update(self, update: ModelPacket, decoder: FrameDecoder, first: int) -> None:
        """Decode frame packets by `update` from now on."""
        assert self.model is not None
        if self._last is not None:
            # Its mode coefficients belong to the model before.
            ratio = update.call.focal_px / self.model.call.focal_px
            face = replace(with_focal_change(self._last.face, ratio), modes=np.zeros(0))
            self._last = replace(self._last, face=face)
        self.model, self._update = update.with_missing_pictures_from(self.model), None
        self._decoder, self._first = decoder, first
        self._layers.drop_before(update.version)

    def _extend_sequence_number(self, sequence: int) -> int | None:
        """The packet's number in the call; None if it is late or a repetition."""
        ahead = (sequence - self._newest) % SEQUENCE_MODULUS
        if self._last is None and self._newest < self._first and ahead > FIRST_WINDOW:
            self._join_late()
            self._newest += ahead - 1
            return self._newest + 1
        if ahead == 0 or ahead >= SEQUENCE_MODULUS - LATE_WINDOW:
            return None
        return self._newest + ahead

    def _join_late(self) -> None:
        self.joined_late = True
        self._next = -1

    def _frames_until(self, call: CallParameters, timed: TimedFace) -> Iterator[PlayoutFrame]:
        """Source frames after those shown before, up to the time of `timed`."""
        before = self._last
        if self._next < 0:
            self._next = ceil(timed.timestamp)
        self._check_gap(call, timed.timestamp)
        while self._next <= timed.timestamp:
            index = self._next
            self._next += 1
            if self._face_lost and before is not None:
                yield PlayoutFrame(index, before.face, True)
            elif before is None or index <= before.timestamp:
                yield PlayoutFrame(index, timed.face, index < call.start_frame)
            else:
                fraction = (index - before.timestamp) / (timed.timestamp - before.timestamp)
                face = interpolate(before.face, timed.face, float(fraction))
                yield PlayoutFrame(index, face, False)

    def _receive_control(
        self, call: CallParameters, packet: ControlPacket
    ) -> Iterator[PlayoutFrame]:
        yield from self._freeze_until(call, packet.frame)
        if packet.kind is ControlKind.END:
            self.ended = True
        elif packet.kind is ControlKind.FACE_LOST:
            self._face_lost = True
        else:
            self._face_lost = False
            self._resynchronise(packet.frame)

    def _freeze_until(self, call: CallParameters, end: int) -> Iterator[PlayoutFrame]:
        """The last face for every source frame before `end`."""
        if self._last is None or self.joined_late:
            return
        self._check_gap(call, end)
        while self._next < end:
            index = self._next
            self._next += 1
            yield PlayoutFrame(index, self._last.face, self._face_lost)

    def _resynchronise(self, frame: int) -> None:
        """Skip the packet numbers before source frame `frame`: without a face none were sent."""
        if not self.joined_late and self._decoder is not None:
            self._newest = max(self._newest, self._first + self._decoder.packet_index_at(frame) - 1)

    def _check_gap(self, call: CallParameters, end: int | Fraction) -> None:
        if end - self._next > MAX_FROZEN_S * call.fps:
            raise ProtocolError(
                f"call jumps from frame {self._next} to {int(end)}, limit {MAX_FROZEN_S} s"
            )


def check_update(call: CallParameters, update: CallParameters) -> None:
    """Raise `ProtocolError` if an update belongs to another call."""
    for one, other in ((call.profile, update.profile), (_shape(call), _shape(update))):
        if one != other:
            raise ProtocolError(f"an update is of another call: {other}, expected {one}")


def _shape(call: CallParameters) -> tuple[int, int, int, int]:
    return call.width, call.height, call.fps_numerator, call.fps_denominator
