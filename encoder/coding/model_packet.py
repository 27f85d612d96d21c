"""Model packets of both profiles, and their byte budgets."""

from dataclasses import dataclass, replace

from encoder.appearance.texture import atlas_size_for, extract_texture
from encoder.capture.video_source import VideoFormat
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.quantised_identity import identity_codes, quantised_identity
from encoder.learning.person_model import PersonModel
from encoder.picture_coding.image_budget import encode_background_webp_within, encode_webp_within
from protocol.call_parameters import CallParameters
from protocol.frames.frame_transform import FrameTransform
from protocol.frames.scalar_quantiser import (
    EAU_STEP,
    codes_from_values,
)
from protocol.frames.transform_coding import serialise_transform
from protocol.model_packet import ModelPacket
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.arrays import Picture
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters


@dataclass(frozen=True, slots=True)
class ModelBudget:
    """Sizes of the pictures of a model packet.

    texture_size: the most texels a side.  appearance_bytes: of texture and modes.
    background_bytes: of the background.  max_modes: 0 in the thesis profile.
    """

    texture_size: int
    appearance_bytes: int
    background_bytes: int
    max_modes: int = 0


# The default profile's budget makes a model of a recorded call at most 12,000 bytes, and the face
# with its shape and tables at most 8192 of them.
BUDGETS = {
    "thesis": ModelBudget(384, 8000, 8000),
    "default": ModelBudget(256, 7340, 3700, 24),
    "live": ModelBudget(256, 8000, 2000, 24),
}

# Up to this rate a model has its usual bytes; beyond they grow by this power of it, so that bits
# for the model and bits for the frames gain about as much in a call of some ten seconds.
USUAL_UP_TO_BPS, GROWTH_POWER, MAX_GROWTH = 1200.0, 2 / 3, 8.0
# Bytes of a model packet besides its pictures: shape, call parameters, the transform's tables.
GEOMETRY_AND_TABLE_BYTES = {"thesis": 400, "default": 600, "live": 600}


def budget_for(
    profile: str, model_bytes: int | None, bitrate: float = USUAL_UP_TO_BPS
) -> ModelBudget:
    """The budget of a profile, or the same scaled to packets of about `model_bytes`.

    profile: "thesis", "default", or "live" for a live call in the default profile.
    model_bytes: None: the usual ones, which grow with the rate of the default profile.
    bitrate: of frame packets, bits a second.
    """
    standard = BUDGETS[profile]
    if model_bytes is not None:
        pictures = standard.appearance_bytes + standard.background_bytes
        scale = (model_bytes - GEOMETRY_AND_TABLE_BYTES[profile]) / pictures
    elif profile == "thesis" or bitrate <= USUAL_UP_TO_BPS:
        return standard
    else:
        scale = min((bitrate / USUAL_UP_TO_BPS) ** GROWTH_POWER, MAX_GROWTH)
    return replace(
        standard,
        appearance_bytes=int(standard.appearance_bytes * scale),
        background_bytes=int(standard.background_bytes * scale),
    )


def call_parameters(
    video: VideoFormat,
    profile: str,
    focal_px: float,
    start_frame: int,
    frames_per_packet: int = 1,
    frame_step: int = 1,
) -> CallParameters:
    """The parameters of a call of a source with this format."""
    return CallParameters(
        profile=profile,
        width=video.width,
        height=video.height,
        fps_numerator=video.fps.numerator,
        fps_denominator=video.fps.denominator,
        focal_px=focal_px,
        frames_per_packet=frames_per_packet,
        start_frame=start_frame,
        frame_step=frame_step,
        colour_matrix=video.colour_matrix,
        sample_aspect=video.sample_aspect,
    )


def geometry_packet(
    fitted: IdentityFit, reference: FaceParameters, call: CallParameters
) -> ModelPacket:
    """A model packet with quantised identity and reference face, without pictures."""
    aau, residual = identity_codes(fitted)
    return ModelPacket(
        call=call,
        aau=aau,
        residual=residual,
        reference_rotation=tuple(reference.pose.rotation.tolist()),
        reference_translation_mm=tuple(reference.pose.translation_mm.tolist()),
        reference_eau=codes_from_values(reference.eau, EAU_STEP, low=-127),
    )


def build_thesis_model_packet(
    head: Head,
    fitted: IdentityFit,
    reference: FaceParameters,
    frame: Picture,
    call: CallParameters,
    budget: ModelBudget,
) -> ModelPacket:
    """The model packet of the thesis profile.

    reference: the face in `frame`, of which background and texture are taken.
    """
    packet = geometry_packet(fitted, reference, call)
    face = Face(head, quantised_identity(head, fitted))
    camera, quantised = call.camera, packet.reference_face
    pose, vertices = quantised.pose, face.animate(quantised.eau)
    size = atlas_size_for(atlas_of(head, 64), camera, pose, vertices, budget.texture_size)
    texture = extract_texture(head, atlas_of(head, size), camera, pose, vertices, frame)
    return replace(
        packet,
        background=encode_background_webp_within(frame, budget.background_bytes),
        texture=encode_webp_within(texture, budget.appearance_bytes),
    )


def build_model_packet(
    person: PersonModel, transform: FrameTransform, call: CallParameters, background: bytes
) -> ModelPacket:
    """The model packet of the default profile.  background: see `Background.encode`."""
    return replace(
        geometry_packet(person.fitted, person.reference, call),
        background=background,
        texture=person.appearance.texture,
        profile_data=serialise_transform(transform),
    )
