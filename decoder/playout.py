"""From packets in any order of arrival to one face per source frame.  Does no input or output.

Samples come less often than source frames; the faces between two samples are interpolated, also
across lost packets.  Before the first sample and after the last the nearest one is held, and while
the encoder has lost the face its last one is held.  A live call is thus one sample interval late.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray

from decoder.frame_decoder import FrameDecoder, TimedFace, frame_decoder_for
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
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
from shared_model.parameters import FaceParameters, refocused

Array = NDArray[np.float64]

# A packet this far behind the newest, in sequence numbers, is late; any other is ahead of it.
LATE_WINDOW = 16
# A call whose first sample has a higher number is one we joined late.
FIRST_WINDOW = 9
# No packet may claim more frames than these beyond the last sample (ten minutes).
MAX_FROZEN_S = 600


@dataclass(frozen=True, slots=True)
class PlayoutFrame:
    """The face to show for source frame `index`; `held`: the encoder had no face there."""

    index: int
    face: FaceParameters
    frozen: bool


class Playout:
    """Turns the packets of one call into the faces of its source frames, in order.

    model: the call's model packet as the newest frames need it, None until one came.  An update
        holds from the frame packet on whose sequence number it bears.  A layered model has in it
        what has come of its layers.
    ended: the END packet has come.
    lost, late, unusable: numbers of frame packets that never came, came too late or twice, or came
        before the model packet.
    """

    def __init__(self) -> None:
        self.model: ModelPacket | None = None
        self.ended = False
        self.joined_late = False
        self.lost = self.late = self.unusable = 0
        self._next = 0
        self._newest = -1  # of the newest sample
        self._last: TimedFace | None = None
        self._decoder: FrameDecoder | None = None
        self._first = 0  # number of the model's first frame packet
        self._update: tuple[ModelPacket, FrameDecoder, int] | None = None
        self._layers = LayerBuffer()
        self._face_lost = False

    def receive(self, data: bytes) -> Iterator[PlayoutFrame]:
        """The frames that can be shown now that the packet `data` has come, perhaps none.

        The packet takes effect as the iterator is consumed.
        Raises `ProtocolError` if the packet is damaged or at odds with the call.
        """
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            self._receive_model(packet)
        elif isinstance(packet, LayerPacket):
            self._receive_layer(packet)
        elif self.model is None or self._decoder is None:
            self.unusable += 1
        elif isinstance(packet, FramePacket):
            yield from self._receive_frame(packet)
        else:
            yield from self._receive_control(self.model.call, packet)

    def _receive_model(self, packet: ModelPacket) -> None:
        """Take the first model packet, and updates; each may be repeated for who joins late."""
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
            # Who joined at an update learns later what that left as it was.
            check_update(self.model.call, packet.call)
            self.model = self.model.with_missing_pictures_from(packet)

    def _receive_layer(self, packet: LayerPacket) -> None:
        """Layers may come before the model that they refine, to who joins late."""
        if self.model is None or packet.model_version >= self.model.version:
            self._layers.add(packet)
        if self.model is not None and packet.model_version == self.model.version:
            self.model = self._layers.apply(self.model)
        elif self._update is not None and packet.model_version == self._update[0].version:
            self._apply_layers_to_update()

    def _apply_layers_to_update(self) -> None:
        """Before the update holds: its first frame packet must not suffer from damaged layers."""
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
        samples = self._decoder.decode(number - self._first, packet.payload)
        self.lost += number - self._newest - 1
        self._newest = number
        for sample in samples:
            yield from self._frames_until(call, sample)
            held = self._face_lost and self._last is not None
            face = self._last.face if held and self._last else sample.face
            self._last = TimedFace(sample.timestamp, face)

    def _activate_update(self, update: ModelPacket, decoder: FrameDecoder, first: int) -> None:
        """Frame packets from now on are of `update`."""
        assert self.model is not None
        if self._last is not None:
            # Its coefficients are of modes that are no more.
            longer = update.call.focal_px / self.model.call.focal_px
            bare = replace(refocused(self._last.face, longer), modes=np.zeros(0))
            self._last = replace(self._last, face=bare)
        self.model, self._update = update.with_missing_pictures_from(self.model), None
        self._decoder, self._first = decoder, first
        self._layers.drop_before(update.version)

    def _extend_sequence_number(self, sequence: int) -> int | None:
        """The sample's number in the call; None if it is late or a repetition."""
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

    def _frames_until(self, call: CallParameters, sample: TimedFace) -> Iterator[PlayoutFrame]:
        """Source frames after those already shown up to the place of `sample`."""
        before = self._last
        if self._next < 0:
            self._next = ceil(sample.timestamp)
        self._check_gap(call, sample.timestamp)
        while self._next <= sample.timestamp:
            index = self._next
            self._next += 1
            if self._face_lost and before is not None:
                yield PlayoutFrame(index, before.face, True)
            elif before is None or index <= before.timestamp:
                yield PlayoutFrame(index, sample.face, index < call.start_frame)
            else:
                share = float((index - before.timestamp) / (sample.timestamp - before.timestamp))
                yield PlayoutFrame(index, interpolate(before.face, sample.face, share), False)

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
        """Expect the samples at and after source frame `frame`: none were sent without a face."""
        if not self.joined_late and self._decoder is not None:
            self._newest = max(self._newest, self._first + self._decoder.packet_index_at(frame) - 1)

    def _check_gap(self, call: CallParameters, end: int | Fraction) -> None:
        if end - self._next > MAX_FROZEN_S * call.fps:
            raise ProtocolError(
                f"call jumps from frame {self._next} to {int(end)}, limit {MAX_FROZEN_S} s"
            )


def check_update(call: CallParameters, update: CallParameters) -> None:
    """Raise `ProtocolError` if an update's call is another than the one it updates."""
    for one, other in ((call.profile, update.profile), (_shape(call), _shape(update))):
        if one != other:
            raise ProtocolError(f"an update is of another call: {other}, expected {one}")


def _shape(call: CallParameters) -> tuple[int, int, int, int]:
    return call.width, call.height, call.fps_numerator, call.fps_denominator
