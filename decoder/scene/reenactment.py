"""Face reenactment: the frames of one call drive the model of another."""

from functools import reduce
from pathlib import Path

import numpy as np

from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import motion_from_pose, pose_from_motion
from protocol.model_packet import ModelPacket
from protocol.packets import LayerPacket, PacketKind, packet_kind, parse_packet
from protocol.progressive_model import LayerBuffer, is_same_model
from shared_model.errors import UserError
from shared_model.parameters import FaceParameters


def read_model(path: Path) -> ModelPacket:
    """The newest model of a call file, with its layers applied.

    Raises `UserError` if the file has no model packet.
    """
    models, pieces, layers = list[ModelPacket](), list[LayerPacket](), LayerBuffer()
    damages = list[ProtocolError]()
    try:
        with CallReader(path) as reader:
            for data in reader.undamaged(damages.append):
                if packet_kind(data) not in (PacketKind.MODEL, PacketKind.LAYER):
                    continue
                packet = parse_packet(data)
                if isinstance(packet, ModelPacket):
                    models.append(packet)
                elif isinstance(packet, LayerPacket):
                    pieces.append(packet)
        if damages and not models:
            raise damages[0]
        if models:
            # Model packets may be repeated for late joiners.
            models.sort(key=lambda model: model.version)
            newest = reduce(_updated, models)
            for piece in pieces:
                if piece.model_version == newest.version:
                    layers.add(piece)
            return layers.apply(newest)
    except ProtocolError as error:
        raise UserError(f"{path}: {error}") from error
    raise UserError(f"{path} has no model packet: nobody to draw")


def _updated(before: ModelPacket, update: ModelPacket) -> ModelPacket:
    return update.with_missing_pictures_from(before)


def reenact(face: FaceParameters, source: ModelPacket, target: ModelPacket) -> FaceParameters:
    """A face of the call of `source`, played by the face of `target`.

    Motion is relative to the reference pose of either.  Actuators apply to any face; modes belong
    to one caller, so the target has its mean texture unless both are the same model.
    """
    if is_same_model(target, source):
        return face
    motion = motion_from_pose(face.pose, source.reference_pose)
    pose = pose_from_motion(motion, target.reference_pose)
    return FaceParameters(pose, face.eau, modes=np.zeros(0))
