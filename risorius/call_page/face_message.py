"""Faces and models to pages that draw them: `player/page` reads what is written here.

A face begins with the header of `messages`, whose byte 0 is that of its stream + 64.  Then, little
endian: its model's number (uint32), how much of the person is shown (float32, 0 to 1), the numbers
of coefficients of layers and of modes (uint16 each), and float32s: rotation (4), translation (3),
the EAUs (14), layers, modes.  A model begins with its stream + 128, then three zeros, its number
(uint32), and a model packet.
"""

import struct
from dataclasses import dataclass

import numpy as np

from risorius.call_page.messages import PictureMessage, Stream, picture_header
from shared_model.parameters import FaceParameters

FACE, MODEL = 64, 128
_FACE = struct.Struct("<If")
_MODEL = struct.Struct("<B3xI")


@dataclass(frozen=True, slots=True)
class FaceMessage:
    """A face; shown: when and in which state, its picture empty.  values: see `face_values`."""

    shown: PictureMessage
    model: int
    presence: float
    values: bytes

    @property
    def stream(self) -> Stream:
        """Whose face it is."""
        return self.shown.stream


@dataclass(frozen=True, slots=True)
class ModelMessage:
    """A model packet, and the number by which faces name it."""

    stream: Stream
    number: int
    packet: bytes


def face_values(face: FaceParameters) -> bytes:
    """The numbers of a face as a message has them."""
    counts = struct.pack("<HH", len(face.layers), len(face.modes))
    parts = face.pose.rotation, face.pose.translation_mm, face.eau, face.layers, face.modes
    return counts + np.concatenate(parts).astype("<f4").tobytes()


def serialise_face(message: FaceMessage) -> bytes:
    """The bytes of a face."""
    head = picture_header(message.shown, FACE)
    return head + _FACE.pack(message.model, message.presence) + message.values


def serialise_model_message(message: ModelMessage) -> bytes:
    """The bytes of a model."""
    return _MODEL.pack(message.stream + MODEL, message.number) + message.packet
