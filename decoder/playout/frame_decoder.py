"""Decoding of frame packets, by the call's profile: faces with their times."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil
from typing import Protocol

from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import face_from_coefficients
from protocol.frames.packet_history import PacketHistory
from protocol.frames.scalar_quantiser import (
    THESIS_RATE_HZ,
    decode_thesis,
    sent_eaus,
)
from protocol.frames.temporal_prediction import FramePredictor
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.picture_residual.framing import covered_frames, split_payload
from protocol.picture_residual.residual_block import CodedResidual
from shared_model.arrays import Integers
from shared_model.parameters import EAU_INDEX, FaceParameters


@dataclass(frozen=True, slots=True)
class TimedFace:
    """A coded face.  timestamp: in source frames from the start of the call."""

    timestamp: Fraction
    face: FaceParameters


class FrameDecoder(Protocol):
    """Decodes the frame packets of one model."""

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """The faces of packet `number` (0 is the model's first).  Raises `ProtocolError`."""

    def residual(self, number: int, payload: bytes, coded: int) -> CodedResidual | None:
        """The picture residual of packet `number`, which has `coded` faces; None: it has none.

        Raises `ProtocolError`.
        """

    def repair(self, number: int, payload: bytes) -> TimedFace | None:
        """Take in a packet that comes after a later one.

        Returns the newest face, if it has changed.  Raises `ProtocolError`.
        """

    def packet_index_at(self, frame: int) -> int:
        """The packet of the first coded face at or after source frame `frame`."""

    def newest_frame(self, number: int) -> Fraction:
        """Time of the last face of packet `number`, source frames from the start of the call."""


def frame_decoder_for(model: ModelPacket) -> FrameDecoder:
    """The decoder of a model's profile.  Raises `ProtocolError` if the model is damaged."""
    return (
        ThesisFrameDecoder(model)
        if model.call.profile == "thesis"
        else PredictiveFrameDecoder(model)
    )


class ThesisFrameDecoder:
    """The thesis profile: one face in each packet, ten a second."""

    def __init__(self, model: ModelPacket) -> None:
        self._model = model
        call: CallParameters = model.call
        self._spacing = Fraction(call.fps_numerator, call.fps_denominator) / THESIS_RATE_HZ

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """See `FrameDecoder`."""
        has_eyelids = self._model.call.has_eyelids
        face = decode_thesis(payload, self._model.reference_pose, has_eyelids)
        # Actuators that the profile does not send keep their values in the background picture.
        eau = self._model.reference_face.eau
        sent = [EAU_INDEX[name] for name in sent_eaus(has_eyelids)]
        eau[sent] = face.eau[sent]
        return [TimedFace(self.newest_frame(number), replace(face, eau=eau))]

    def residual(self, number: int, payload: bytes, coded: int) -> None:
        """See `FrameDecoder`: the profile has none."""

    def repair(self, number: int, payload: bytes) -> TimedFace | None:
        """See `FrameDecoder`: no packet depends on another."""
        self.decode(number, payload)
        return None

    def packet_index_at(self, frame: int) -> int:
        """See `FrameDecoder`."""
        return ceil((frame - self._model.call.start_frame) / self._spacing)

    def newest_frame(self, number: int) -> Fraction:
        """See `FrameDecoder`."""
        return self._model.call.start_frame + number * self._spacing


class PredictiveFrameDecoder:
    """The default profile: packet 0 has one frame, later ones `frames_per_packet`."""

    def __init__(self, model: ModelPacket) -> None:
        self._model = model
        self._transform = parse_transform(model.profile_data)
        if bool(self._transform.reserved_modes) != model.extensible:
            raise ProtocolError(
                f"{self._transform.reserved_modes} reserved modes, extensible: {model.extensible}"
            )
        predictor = FramePredictor(self._transform.scale_codes, self._transform.reserved_modes)
        self._history = PacketHistory(predictor, model.call.frames_per_packet)
        self._newest = -1

    def decode(self, number: int, payload: bytes) -> list[TimedFace]:
        """See `FrameDecoder`."""
        frames = self._history.decode(number, self._split(payload)[1])
        self._newest = number
        return self._timed(number, frames)

    def repair(self, number: int, payload: bytes) -> TimedFace | None:
        """See `FrameDecoder`."""
        frames = self._history.insert(number, self._split(payload)[1])
        return None if frames is None else self._timed(self._newest, frames)[-1]

    def residual(self, number: int, payload: bytes, coded: int) -> CodedResidual | None:
        """See `FrameDecoder`."""
        call, data = self._model.call, self._split(payload)[0]
        if not data:
            return None
        covered = covered_frames(call, number, coded)
        return CodedResidual(data, call.width, call.height, covered.start, len(covered))

    def _split(self, payload: bytes) -> tuple[bytes, bytes]:
        """The bytes of the picture residual, which may be none, and those of the faces."""
        return split_payload(payload) if self._model.call.has_residual else (b"", payload)

    def packet_index_at(self, frame: int) -> int:
        """See `FrameDecoder`."""
        call = self._model.call
        return max(0, ceil((frame - call.start_frame) / (call.frame_step * call.frames_per_packet)))

    def newest_frame(self, number: int) -> Fraction:
        """See `FrameDecoder`; a packet at the end of a call may have fewer faces."""
        call = self._model.call
        return Fraction(call.start_frame + number * call.frames_per_packet * call.frame_step)

    def _timed(self, number: int, frames: Sequence[Integers]) -> list[TimedFace]:
        call, reference = self._model.call, self._model.reference_pose
        first = 1 + (number - 1) * call.frames_per_packet if number else 0
        timestamps = [call.start_frame + (first + i) * call.frame_step for i in range(len(frames))]
        return [
            TimedFace(
                Fraction(timestamp), face_from_coefficients(self._transform, coded, reference)
            )
            for timestamp, coded in zip(timestamps, frames, strict=True)
        ]
