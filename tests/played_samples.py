"""A call of the thesis profile whose jaw tells which of its samples a face is; and its play-out."""

import numpy as np

from decoder.playout.playout import Playout, PlayoutFrame
from protocol.call_parameters import CallParameters
from protocol.frames.scalar_quantiser import encode_thesis
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, parse_packet, serialise
from shared_model.geometry import pose_from_euler
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters, Pose

REFERENCE = pose_from_euler(2, -3, 1, np.array([10.0, -20.0, 650.0]))
JAW = EAU_INDEX["jaw_drop"]


def model(fps: tuple[int, int] = (25, 1), start: int = 0, profile: str = "thesis") -> bytes:
    call = CallParameters(profile, 176, 144, *fps, 300.0, start_frame=start)
    rotation, translation = map(tuple, (REFERENCE.rotation, REFERENCE.translation_mm))
    return serialise(ModelPacket(call, (0,) * len(AAUS), rotation, translation, (0,) * len(EAUS)))


def face(number: int) -> FaceParameters:
    """The face of sample `number`: the jaw opens by 1/254 a sample."""
    eau = np.zeros(len(EAUS))
    eau[JAW] = (number % 200) / 254
    translation = REFERENCE.translation_mm + np.array([number % 50, 0.0, 0.0])
    return FaceParameters(Pose(REFERENCE.rotation, translation), eau)


def sample(number: int) -> bytes:
    return serialise(FramePacket(number % 64, encode_thesis(face(number), REFERENCE)))


def control(kind: ControlKind, frame: int) -> bytes:
    return serialise(ControlPacket(0, kind, frame))


def play(packets: list[bytes], playout: Playout | None = None) -> list[PlayoutFrame]:
    playout = playout or Playout()
    return [frame for data in packets for frame in playout.receive(parse_packet(data))]


def jaw(frames: list[PlayoutFrame]) -> list[float]:
    return [254 * float(frame.face.eau[JAW]) for frame in frames]
