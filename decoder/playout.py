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

from decoder.frame_decoder import Sample, SampleDecoder, sample_decoder
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
from shared_model.geometry import (
    conjugate,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import FaceParameters, Pose, refocused

Array = NDArray[np.float64]

# A packet this far behind the newest, in sequence numbers, is late; any other is ahead of it.
LATE_WINDOW = 16
# A call whose first sample has a higher number is one we joined late.
FIRST_WINDOW = 9
# No packet may claim more frames than these beyond the last sample (ten minutes).
MAX_HELD_S = 600


@dataclass(frozen=True, slots=True)
class PlayedFrame:
    """The face to show for source frame `index`; `held`: the encoder had no face there."""

    index: int
    face: FaceParameters
    held: bool


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
        self._number = -1  # of the newest sample
        self._sample: Sample | None = None
        self._decoder: SampleDecoder | None = None
        self._first = 0  # number of the model's first frame packet
        self._update: tuple[ModelPacket, SampleDecoder, int] | None = None
        self._layers = LayerBuffer()
        self._face_lost = False

    def receive(self, data: bytes) -> Iterator[PlayedFrame]:
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
            self.model, self._decoder = packet, sample_decoder(packet)
            self._first, self._number = packet.sequence, packet.sequence - 1
            if packet.version:
                self._join_late()
            self.model = self._layers.apply(packet)
        elif packet.version > newest.version:
            check_update(newest.call, packet.call)
            ahead = (packet.sequence - self._number) % SEQUENCE_MODULUS
            self._update = packet, sample_decoder(packet), self._number + ahead
            self._refine_update()
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
            self._refine_update()

    def _refine_update(self) -> None:
        """Before the update holds: its first frame packet must not suffer from damaged layers."""
        assert self._update is not None
        model, decoder, first = self._update
        self._update = self._layers.apply(model), decoder, first

    def _receive_frame(self, packet: FramePacket) -> Iterator[PlayedFrame]:
        number = self._unwrap(packet.sequence)
        if number is None:
            self.late += 1
            return
        if self._update is not None and number >= self._update[2]:
            self._enter(*self._update)
        assert self.model is not None and self._decoder is not None
        call = self.model.call
        samples = self._decoder.decode(number - self._first, packet.payload)
        self.lost += number - self._number - 1
        self._number = number
        for sample in samples:
            yield from self._frames_until(call, sample)
            held = self._face_lost and self._sample is not None
            face = self._sample.face if held and self._sample else sample.face
            self._sample = Sample(sample.place, face)

    def _enter(self, update: ModelPacket, decoder: SampleDecoder, first: int) -> None:
        """Frame packets from now on are of `update`."""
        assert self.model is not None
        if self._sample is not None:
            # Its coefficients are of modes that are no more.
            longer = update.call.focal_px / self.model.call.focal_px
            bare = replace(refocused(self._sample.face, longer), modes=np.zeros(0))
            self._sample = replace(self._sample, face=bare)
        self.model, self._update = update.with_missing_pictures_from(self.model), None
        self._decoder, self._first = decoder, first
        self._layers.drop_before(update.version)

    def _unwrap(self, sequence: int) -> int | None:
        """The sample's number in the call; None if it is late or a repetition."""
        ahead = (sequence - self._number) % SEQUENCE_MODULUS
        if self._sample is None and self._number < self._first and ahead > FIRST_WINDOW:
            self._join_late()
            self._number += ahead - 1
            return self._number + 1
        if ahead == 0 or ahead >= SEQUENCE_MODULUS - LATE_WINDOW:
            return None
        return self._number + ahead

    def _join_late(self) -> None:
        self.joined_late = True
        self._next = -1

    def _frames_until(self, call: CallParameters, sample: Sample) -> Iterator[PlayedFrame]:
        """Source frames after those already shown up to the place of `sample`."""
        before = self._sample
        if self._next < 0:
            self._next = ceil(sample.place)
        self._check_held(call, sample.place)
        while self._next <= sample.place:
            index = self._next
            self._next += 1
            if self._face_lost and before is not None:
                yield PlayedFrame(index, before.face, True)
            elif before is None or index <= before.place:
                yield PlayedFrame(index, sample.face, index < call.start_frame)
            else:
                share = float((index - before.place) / (sample.place - before.place))
                yield PlayedFrame(index, interpolate(before.face, sample.face, share), False)

    def _receive_control(
        self, call: CallParameters, packet: ControlPacket
    ) -> Iterator[PlayedFrame]:
        yield from self._hold_until(call, packet.frame)
        if packet.kind is ControlKind.END:
            self.ended = True
        elif packet.kind is ControlKind.FACE_LOST:
            self._face_lost = True
        else:
            self._face_lost = False
            self._skip_to(packet.frame)

    def _hold_until(self, call: CallParameters, end: int) -> Iterator[PlayedFrame]:
        """The last face for every source frame before `end`."""
        if self._sample is None or self.joined_late:
            return
        self._check_held(call, end)
        while self._next < end:
            index = self._next
            self._next += 1
            yield PlayedFrame(index, self._sample.face, self._face_lost)

    def _skip_to(self, frame: int) -> None:
        """Expect the samples at and after source frame `frame`: none were sent without a face."""
        if not self.joined_late and self._decoder is not None:
            self._number = max(self._number, self._first + self._decoder.number_at(frame) - 1)

    def _check_held(self, call: CallParameters, end: int | Fraction) -> None:
        if end - self._next > MAX_HELD_S * call.fps:
            raise ProtocolError(
                f"call jumps from frame {self._next} to {int(end)}, limit {MAX_HELD_S} s"
            )


def check_update(call: CallParameters, update: CallParameters) -> None:
    """Raise `ProtocolError` if an update's call is another than the one it updates."""
    for one, other in ((call.profile, update.profile), (_shape(call), _shape(update))):
        if one != other:
            raise ProtocolError(f"an update is of another call: {other}, expected {one}")


def _shape(call: CallParameters) -> tuple[int, int, int, int]:
    return call.width, call.height, call.fps_numerator, call.fps_denominator


def interpolate(first: FaceParameters, second: FaceParameters, share: float) -> FaceParameters:
    """The face `share` (0..1) of the way: rotation along the shortest arc, all else linearly."""
    turn = vector_from_quaternion(multiply(second.pose.rotation, conjugate(first.pose.rotation)))
    rotation = multiply(quaternion_from_vector(share * turn), first.pose.rotation)
    return FaceParameters(
        Pose(
            normalise(rotation),
            _mix(first.pose.translation_mm, second.pose.translation_mm, share),
        ),
        _mix(first.eau, second.eau, share),
        # After an update there are none yet.
        _mix(first.modes, second.modes, share)
        if first.modes.shape == second.modes.shape
        else second.modes,
        _mix(first.light, second.light, share),
    )


def _mix(first: Array, second: Array, share: float) -> Array:
    return np.asarray(first + share * (second - first))
