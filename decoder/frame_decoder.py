"""What a frame packet's payload says, by the call's profile: faces, each at its place in time."""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil
from typing import Protocol

from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import face_from_coefficients, parse_transform
from protocol.frames.payload_coding import decode_payload
from protocol.frames.scalar_quantiser import (
    EAU_STEP,
    THESIS_RATE_HZ,
    decode_thesis,
    sent_eaus,
    values_from_codes,
)
from protocol.frames.temporal_prediction import FramePredictor
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from shared_model.parameters import EAU_INDEX, FaceParameters


@dataclass(frozen=True, slots=True)
class TimedFace:
    """A face that was sent, and its place in source frames."""

    timestamp: Fraction
    face: FaceParameters


class FrameDecoder(Protocol):
    """Decodes the frame packets of one call."""

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """The samples of packet `number` (0 = the call's first).  Raises `ProtocolError`."""

    def packet_index_at(self, frame: int) -> int:
        """The packet in which the first sample at or after source frame `frame` is sent."""


def frame_decoder_for(model: ModelPacket) -> FrameDecoder:
    """The decoder for a call's profile.  Raises `ProtocolError` if its model is damaged."""
    return (
        ThesisFrameDecoder(model)
        if model.call.profile == "thesis"
        else PredictiveFrameDecoder(model)
    )


class ThesisFrameDecoder:
    """One face in each packet, ten a second."""

    def __init__(self, model: ModelPacket) -> None:
        self._model = model
        call: CallParameters = model.call
        self._spacing = Fraction(call.fps_numerator, call.fps_denominator) / THESIS_RATE_HZ

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """See `SampleDecoder`."""
        lids = self._model.call.has_eyelids
        face = decode_thesis(payload, self._model.reference_pose, lids)
        # What the profile does not send stays as it was in the still.
        eau = values_from_codes(self._model.reference_eau, EAU_STEP)
        sent = [EAU_INDEX[name] for name in sent_eaus(lids)]
        eau[sent] = face.eau[sent]
        place = self._model.call.start_frame + number * self._spacing
        return [TimedFace(place, replace(face, eau=eau))]

    def packet_index_at(self, frame: int) -> int:
        """See `SampleDecoder`."""
        return ceil((frame - self._model.call.start_frame) / self._spacing)


class PredictiveFrameDecoder:
    """Every coded frame: the first alone in packet 0, then as many a packet as the call says."""

    def __init__(self, model: ModelPacket) -> None:
        self._model = model
        self._components = parse_transform(model.profile_data)
        if bool(self._components.reserved_modes) != model.extensible:
            raise ProtocolError(
                f"{self._components.reserved_modes} spare modes, growing: {model.extensible}"
            )
        self._predictor = FramePredictor(
            self._components.scale_codes, self._components.reserved_modes
        )

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """See `SampleDecoder`."""
        call, reference = self._model.call, self._model.reference_pose
        usual = call.frames_per_packet
        frames = decode_payload(self._predictor, number % SEQUENCE_MODULUS, usual, payload)
        first = 1 + (number - 1) * usual if number else 0
        places = [call.start_frame + (first + i) * call.frame_step for i in range(len(frames))]
        return [
            TimedFace(Fraction(place), face_from_coefficients(self._components, coded, reference))
            for place, coded in zip(places, frames, strict=True)
        ]

    def packet_index_at(self, frame: int) -> int:
        """See `SampleDecoder`."""
        call = self._model.call
        return max(0, ceil((frame - call.start_frame) / (call.frame_step * call.frames_per_packet)))
