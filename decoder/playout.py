"""From packets in any order of arrival to one face per source frame.  Does no input or output.

Samples come less often than source frames; the faces between two samples are interpolated, also
across lost packets.  Before the first sample and after the last the nearest one is held, and while
the encoder has lost the face its last one is held.  A live call is thus one sample interval late.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray

from decoder.samples import Sample, SampleDecoder, sample_decoder
from protocol.messages import (
    SEQUENCE_MODULUS,
    CallParameters,
    ControlKind,
    ControlPacket,
    FramePacket,
    ModelPacket,
    ProtocolError,
    parse_packet,
)
from shared_model.geometry import (
    conjugate,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import FaceParameters, Pose

Array = NDArray[np.float64]

# A packet this far behind the newest, in sequence numbers, is late; any other is ahead of it.
LATE_WINDOW = 16
# A call whose first sample has a higher number is one we joined late.
FIRST_WINDOW = 8
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

    model: the call's model packet, None until it came.
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
        self._face_lost = False

    def receive(self, data: bytes) -> Iterator[PlayedFrame]:
        """The frames that can be shown now that the packet `data` has come, perhaps none.

        The packet takes effect as the iterator is consumed.
        Raises `ProtocolError` if the packet is damaged or at odds with the call.
        """
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            # A model packet may be repeated for those who join late; the first usable one counts.
            if self.model is None:
                self._decoder = sample_decoder(packet)
                self.model = packet
        elif self.model is None or self._decoder is None:
            self.unusable += 1
        elif isinstance(packet, FramePacket):
            yield from self._receive_frame(self.model.call, self._decoder, packet)
        else:
            yield from self._receive_control(self.model.call, packet)

    def _receive_frame(
        self, call: CallParameters, decoder: SampleDecoder, packet: FramePacket
    ) -> Iterator[PlayedFrame]:
        number = self._unwrap(packet.sequence)
        if number is None:
            self.late += 1
            return
        samples = decoder.decode(number, packet.payload)
        self.lost += number - self._number - 1
        self._number = number
        for sample in samples:
            yield from self._frames_until(call, sample)
            held = self._face_lost and self._sample is not None
            face = self._sample.face if held and self._sample else sample.face
            self._sample = Sample(sample.place, face)

    def _unwrap(self, sequence: int) -> int | None:
        """The sample's number in the call; None if it is late or a repetition."""
        if self._sample is None and self._number < 0 and sequence > FIRST_WINDOW:
            self.joined_late = True
            self._number = sequence - 1
            self._next = -1
            return sequence
        ahead = (sequence - self._number) % SEQUENCE_MODULUS
        if ahead == 0 or ahead >= SEQUENCE_MODULUS - LATE_WINDOW:
            return None
        return self._number + ahead

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
        elif packet.kind is ControlKind.LOST:
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
            self._number = max(self._number, self._decoder.number_at(frame) - 1)

    def _check_held(self, call: CallParameters, end: int | Fraction) -> None:
        if end - self._next > MAX_HELD_S * call.fps:
            raise ProtocolError(
                f"call jumps from frame {self._next} to {int(end)}, limit {MAX_HELD_S} s"
            )


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
        _mix(first.modes, second.modes, share),
        _mix(first.light, second.light, share),
    )


def _mix(first: Array, second: Array, share: float) -> Array:
    return np.asarray(first + share * (second - first))
