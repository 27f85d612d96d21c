"""Another's face for a call: its identity, texture and still, moved by this call's stream."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from decoder.playout import PlayedFrame
from protocol.messages import Kind, ModelPacket, ProtocolError, packet_kind, parse_packet
from protocol.quantise import motion_from_pose, pose_from_motion
from protocol.recording import CallReader
from shared_model.errors import UserError
from shared_model.parameters import FaceParameters


def read_model(path: Path) -> ModelPacket:
    """The first model packet of a call file.  Raises `UserError` if there is none."""
    try:
        with CallReader(path) as reader:
            for data in reader:
                packet = parse_packet(data) if packet_kind(data) == Kind.MODEL else None
                if isinstance(packet, ModelPacket):
                    return packet
    except ProtocolError as error:
        raise UserError(f"{path}: {error}") from error
    raise UserError(f"{path} has no model packet: nobody to draw")


def recast(frame: PlayedFrame, sender: ModelPacket, worn: ModelPacket) -> PlayedFrame:
    """The frame of `sender`'s stream as the face of `worn` plays it.

    Its head moves from its own reference pose as the sender's does from theirs; actuators are
    everybody's.  Modes are of one caller: unless both are the same model, the mean is worn.
    """
    if worn == sender:
        return frame
    face = frame.face
    motion = motion_from_pose(face.pose, sender.reference_pose)
    pose = pose_from_motion(motion, worn.reference_pose)
    return replace(frame, face=FaceParameters(pose, face.eau, modes=np.zeros(0)))
