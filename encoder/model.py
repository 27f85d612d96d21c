"""The model packet: who calls, as the first good frame shows it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.fit import Fitted
from encoder.texture import compress, compress_background, extract_texture, fitting_size
from protocol.messages import CallParameters, ModelPacket
from protocol.quantise import (
    AAU_STEP,
    EAU_STEP,
    RESIDUAL_STEP_MM,
    codes_from_values,
    values_from_codes,
)
from shared_model.animate import Face, Identity, identity_from_controls
from shared_model.appearance import generic_atlas
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters, Pose

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Budget:
    """Sizes of the model packet's images: most texels a side of the texture, bytes of each."""

    texture_size: int = 384
    texture_bytes: int = 8000
    background_bytes: int = 8000


def build_model(
    head: Head,
    fitted: Fitted,
    reference: FaceParameters,
    frame: Picture,
    call: CallParameters,
    budget: Budget,
) -> ModelPacket:
    """The packet that lets a decoder draw this caller.

    The texture is sampled through the shape as the decoder will have it, after quantisation, so that
    rounding of the shape moves no texel.
    reference: the caller in `frame`, the picture that still and texture are taken from.
    """
    aau = codes_from_values(fitted.identity.aau, AAU_STEP)
    residual = codes_from_values(fitted.control_mm, RESIDUAL_STEP_MM)
    eau = codes_from_values(reference.eau, EAU_STEP, low=-127)
    rotation, translation = reference.pose.rotation, reference.pose.translation_mm
    draft = ModelPacket(
        call=call,
        aau=aau,
        residual=residual,
        reference_rotation=tuple(rotation.tolist()),
        reference_translation_mm=tuple(translation.tolist()),
        reference_eau=eau,
    )
    face = Face(head, identity_of(head, draft))
    camera, pose = call.camera, draft.reference_pose
    vertices = face.animate(values_from_codes(eau, EAU_STEP))
    size = fitting_size(generic_atlas(64), camera, pose, vertices, budget.texture_size)
    texture = extract_texture(head, generic_atlas(size), camera, pose, vertices, frame)
    return ModelPacket(
        call=call,
        aau=aau,
        residual=residual,
        reference_rotation=draft.reference_rotation,
        reference_translation_mm=draft.reference_translation_mm,
        reference_eau=eau,
        background=compress_background(frame, budget.background_bytes),
        texture=compress(texture, budget.texture_bytes),
    )


def identity_of(head: Head, packet: ModelPacket) -> Identity:
    """The identity a decoder reads from the packet."""
    control = values_from_codes(packet.residual, RESIDUAL_STEP_MM).reshape(-1, 3)
    return identity_from_controls(head, values_from_codes(packet.aau, AAU_STEP), control)


def reference_of(packet: ModelPacket) -> FaceParameters:
    """The face in the still, as a decoder reads it."""
    pose: Pose = packet.reference_pose
    return FaceParameters(pose, values_from_codes(packet.reference_eau, EAU_STEP))
