"""The model packet: who calls, as the first good frame shows it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.texture import extract_texture, fitting_size
from encoder.capture.video_source import Capture
from encoder.fitting.identity import Fitted
from encoder.picture_coding.image_budget import compress, compress_background
from protocol.frames.scalar_quantiser import (
    AAU_STEP,
    EAU_STEP,
    RESIDUAL_STEP_MM,
    codes_from_values,
    values_from_codes,
)
from protocol.packets import CallParameters, ModelPacket
from shared_model.animate import Face, Identity, identity_from_controls
from shared_model.appearance import atlas_of
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters, Pose

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Budget:
    """Sizes of the model packet's images.

    texture_size: most texels a side.  face_bytes: of the texture and all appearance modes.
    background_bytes: of the still.  most_modes: in the default profile.
    """

    texture_size: int
    face_bytes: int
    background_bytes: int
    most_modes: int = 0


# Of a recorded call in the default profile so much that a minute of it takes 16 kB, and the face,
# shape included, 8192 bytes: 7728 to 8156 on seven clips, at .1 dB less than 8.1 to 8.4 kB gave.
BUDGETS = {
    "thesis": Budget(384, 8000, 8000),
    "default": Budget(256, 7540, 1880, 24),
    "live": Budget(256, 8000, 2000, 24),
}

# What a model packet holds beside its images: shape, call parameters, the components' tables.
SHAPE_BYTES = {"thesis": 400, "default": 600, "live": 600}


def budget_for(profile: str, model_bytes: int | None) -> Budget:
    """The usual sizes, or all images scaled so that the packet takes about `model_bytes`.

    profile: `live` is a live call in the default one.
    """
    usual = BUDGETS[profile]
    if model_bytes is None:
        return usual
    share = (model_bytes - SHAPE_BYTES[profile]) / (usual.face_bytes + usual.background_bytes)
    return replace(
        usual,
        face_bytes=int(usual.face_bytes * share),
        background_bytes=int(usual.background_bytes * share),
    )


def call_parameters(
    capture: Capture,
    profile: str,
    focal_px: float,
    start_frame: int,
    frames_per_packet: int = 1,
    frame_step: int = 1,
) -> CallParameters:
    """What stays the same throughout a call of this source."""
    return CallParameters(
        profile=profile,
        width=capture.width,
        height=capture.height,
        fps_numerator=capture.fps.numerator,
        fps_denominator=capture.fps.denominator,
        focal_px=focal_px,
        frames_per_packet=frames_per_packet,
        start_frame=start_frame,
        frame_step=frame_step,
        matrix=capture.matrix,
    )


def shape_packet(fitted: Fitted, reference: FaceParameters, call: CallParameters) -> ModelPacket:
    """The packet's geometry, quantised; its images are still empty.

    Textures must be sampled through the shape as the decoder will have it, so that rounding of the
    shape moves no texel.
    """
    return ModelPacket(
        call=call,
        aau=codes_from_values(fitted.identity.aau, AAU_STEP),
        residual=codes_from_values(fitted.control_mm, RESIDUAL_STEP_MM),
        reference_rotation=tuple(reference.pose.rotation.tolist()),
        reference_translation_mm=tuple(reference.pose.translation_mm.tolist()),
        reference_eau=codes_from_values(reference.eau, EAU_STEP, low=-127),
    )


def build_model(
    head: Head,
    fitted: Fitted,
    reference: FaceParameters,
    frame: Picture,
    call: CallParameters,
    budget: Budget,
) -> ModelPacket:
    """The packet that lets a decoder draw this caller in the thesis profile.

    reference: the caller in `frame`, the picture that still and texture are taken from.
    """
    draft = shape_packet(fitted, reference, call)
    face = Face(head, identity_of(head, draft))
    camera, seen = call.camera, reference_of(draft)
    vertices = face.animate(seen.eau)
    size = fitting_size(atlas_of(head, 64), camera, seen.pose, vertices, budget.texture_size)
    texture = extract_texture(head, atlas_of(head, size), camera, seen.pose, vertices, frame)
    return replace(
        draft,
        background=compress_background(frame, budget.background_bytes),
        texture=compress(texture, budget.face_bytes),
    )


def identity_of(head: Head, packet: ModelPacket) -> Identity:
    """The identity a decoder reads from the packet."""
    control = values_from_codes(packet.residual, RESIDUAL_STEP_MM).reshape(-1, 3)
    return identity_from_controls(head, values_from_codes(packet.aau, AAU_STEP), control)


def reference_of(packet: ModelPacket) -> FaceParameters:
    """The face in the still, as a decoder reads it."""
    pose: Pose = packet.reference_pose
    return FaceParameters(pose, values_from_codes(packet.reference_eau, EAU_STEP))
