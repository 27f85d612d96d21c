"""Sample packets for the tests of the wire."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from protocol.call_parameters import CallParameters
from protocol.entropy.varint import encode_varint
from protocol.frames.frame_times import TimesPacket
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    Packet,
)
from shared_model.parameters import EAUS

VECTORS = Path(__file__).parent / "vectors"

CALL = CallParameters("thesis", 640, 480, 30000, 1001, 612.5)
MODEL = ModelPacket(
    call=CALL,
    aau=tuple(range(-5, 6)),
    reference_rotation=(0.0, 1.0, 0.0, 0.0),
    reference_translation_mm=(10.5, -20.25, 600.0),
    reference_eau=tuple(range(-7, len(EAUS) - 7)),
    background=b"background",
    texture=b"texture",
    residual=(1, -2, 3, 127, -128, 0),
    sequence=5,
)
GOLDEN: dict[str, Packet] = {
    "model": MODEL,
    "model_update": replace(
        MODEL,
        call=replace(CALL, profile="default", frames_per_packet=6, start_frame=300),
        residual=(),
        background=b"",
        profile_data=b"modes",
        version=2,
        version_count=5,
    ),
    "model_step": replace(MODEL, call=replace(CALL, profile="default", frame_step=3)),
    "model_progressive": replace(MODEL, progressive=True),
    "model_extensible": replace(MODEL, extensible=True),
    "model_eyelids": replace(MODEL, call=replace(CALL, has_eyelids=True)),
    "model_bt709": replace(MODEL, call=replace(CALL, profile="default", colour_matrix="bt709")),
    "model_voice": replace(MODEL, call=replace(CALL, profile="default", voice="1200")),
    "model_residual": replace(MODEL, call=replace(CALL, profile="default", has_residual=True)),
    "model_aspect": replace(MODEL, call=replace(CALL, sample_aspect=Fraction(16, 11))),
    "layer": LayerPacket(2, 300, b"a piece"),
    "frame_thesis": FramePacket(63, bytes(range(123, 133))),
    "frame_eyelids": FramePacket(0, bytes(range(120, 132))),
    "frame_empty": FramePacket(1, b""),
    "control_end": ControlPacket(7, ControlKind.END, 382),
    "control_lost": ControlPacket(0, ControlKind.FACE_LOST, 0),
    "control_times": TimesPacket(0, 320, (9, 9, 9, 57, 56)),
    "control_camera": ControlPacket(2, ControlKind.CAMERA_OFF, 75),
    "control_joined": ControlPacket(0, ControlKind.JOINED, 513),
    "control_found": ControlPacket(33, ControlKind.FACE_FOUND, 2**32 - 1),
}


def sent_bytes(packet: bytes) -> int:
    """Bytes of a packet with its length, as a pacer counts them."""
    return len(encode_varint(len(packet))) + len(packet)
