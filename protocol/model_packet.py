"""The model packet: the caller's shape and pictures, and their encoding on the wire.

The payload is a format number (one byte) and a MessagePack map with the keys of that format, in a
fixed order.  Every packet has exactly one encoding.
"""

import math
import struct
from dataclasses import dataclass, replace
from typing import Any

import msgpack  # type: ignore[import-untyped]
import numpy as np

from protocol.call_parameters import COLOUR_MATRICES, PROFILES, CallParameters, voice_of
from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.entropy.validation import (
    as_float32s,
    check_bool,
    check_bytes,
    check_codes,
    check_int,
)
from protocol.frames.scalar_quantiser import EAU_STEP, values_from_codes
from protocol.limits import (
    MAX_IMAGE_BYTES,
    MAX_MODEL_VERSIONS,
    MAX_PROFILE_DATA_BYTES,
    MAX_RESIDUAL_BYTES,
    MAX_RESIDUAL_POINTS,
    MAX_TRANSLATION_MM,
    SEQUENCE_MODULUS,
    VOICE_NUMBERS,
)
from protocol.sample_aspect import aspect_of
from shared_model.geometry import normalise
from shared_model.parameters import AAUS, EAUS, FaceParameters, Pose

# A model packet has the lowest format number whose keys hold all its fields.  The colour matrix
# shares a field with the profile, so it needs no format of its own: a program that knows no matrix
# but bt601 refuses the field's value.
THESIS_FORMAT = 15
EYELIDS_FORMAT = 16
DEFAULT_FORMAT = 17
PROGRESSIVE_FORMAT = 18
EXTENSIBLE_FORMAT = 19
VOICE_FORMAT = 20
ASPECT_FORMAT = 21
PICTURE_RESIDUAL_FORMAT = 22
_THESIS_FORMATS = THESIS_FORMAT, EYELIDS_FORMAT
_DEFAULT_FORMATS = DEFAULT_FORMAT, PROGRESSIVE_FORMAT, EXTENSIBLE_FORMAT
FORMATS = (
    *_THESIS_FORMATS,
    *_DEFAULT_FORMATS,
    VOICE_FORMAT,
    ASPECT_FORMAT,
    PICTURE_RESIDUAL_FORMAT,
)
AXES = 3


@dataclass(frozen=True, slots=True)
class ModelPacket:
    """One caller: shape, background picture, texture and what the profile adds.

    call: the parameters of the call.
    aau: len(AAUS) codes -128..127, in steps of `scalar_quantiser.AAU_STEP`.
    reference_rotation, reference_translation_mm: the pose in the background picture, `Pose`;
        rounded to single precision.
    reference_eau: len(EAUS) codes -127..127 of that picture, steps of `scalar_quantiser.EAU_STEP`.
    background, texture: encoded pictures; an empty one of an update stands for that of the version
        before.
    residual: x, y, z codes -128..127 of each control point of the residual shape, in steps of
        `scalar_quantiser.RESIDUAL_STEP_MM`.
    profile_data: of the default profile, its frame transform and modes, see `frame_transform`.
    version, version_count: this is version number `version` of `version_count`; each replaces the
        one before.
    sequence: sequence number of the first frame packet that is coded by this model.
    progressive: pictures are of low quality and modes are empty; layer packets bring the rest, see
        `progressive_model`.
    extensible: `profile_data` has reserved modes, which are sent during the call.
    """

    call: CallParameters
    aau: tuple[int, ...]
    reference_rotation: tuple[float, ...]
    reference_translation_mm: tuple[float, ...]
    reference_eau: tuple[int, ...]
    background: bytes = b""
    texture: bytes = b""
    residual: tuple[int, ...] = ()
    profile_data: bytes = b""
    version: int = 0
    version_count: int = 1
    sequence: int = 0
    progressive: bool = False
    extensible: bool = False

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_codes("aau", self.aau, len(AAUS), -128)
        check_codes("reference eau", self.reference_eau, len(EAUS), -127)
        if len(self.residual) % 3:
            raise ValueError(f"residual has {len(self.residual)} codes, expected three per point")
        check_int("number of residual points", len(self.residual) // 3, 0, MAX_RESIDUAL_POINTS)
        check_codes("residual", self.residual, len(self.residual), -128)
        check_bytes("background", self.background, MAX_IMAGE_BYTES)
        check_bytes("texture", self.texture, MAX_IMAGE_BYTES)
        check_bytes("profile data", self.profile_data, MAX_PROFILE_DATA_BYTES)
        check_int("number of model versions", self.version_count, 1, MAX_MODEL_VERSIONS)
        check_int("model version", self.version, 0, self.version_count - 1)
        check_bool("progressive", self.progressive)
        check_bool("extensible", self.extensible)
        rotation = as_float32s("reference rotation", self.reference_rotation, 4, 1.001)
        norm = math.hypot(*rotation)
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"reference rotation has length {norm}, expected 1")
        translation = as_float32s(
            "reference translation", self.reference_translation_mm, 3, MAX_TRANSLATION_MM
        )
        if translation[2] <= 0:
            raise ValueError(f"reference depth is {translation[2]} mm, expected more than 0")
        object.__setattr__(self, "reference_rotation", rotation)
        object.__setattr__(self, "reference_translation_mm", translation)

    @property
    def reference_pose(self) -> Pose:
        """The pose in the background picture."""
        rotation = normalise(np.array(self.reference_rotation))
        return Pose(rotation, np.array(self.reference_translation_mm))

    @property
    def reference_face(self) -> FaceParameters:
        """The face in the background picture; its coefficients are 0."""
        eau = values_from_codes(self.reference_eau, EAU_STEP)
        return FaceParameters(self.reference_pose, eau)

    def with_missing_pictures_from(self, before: "ModelPacket") -> "ModelPacket":
        """This packet, its empty pictures replaced by those of the version `before`."""
        return replace(
            self,
            background=self.background or before.background,
            texture=self.texture or before.texture,
        )


# Keys of the map, one letter each because they are sent.
_KEYS = ("p", "s", "r", "f", "n", "o", "l", "a", "d", "q", "t", "e", "b", "x", "m")
# Further keys; each format has so many of them.
_FURTHER_KEYS = ("k", "y", "g", "i", "v", "z", "w")
_DEFAULTS: tuple[Any, ...] = (1, False, False, False, 0, (1, 1), False)
_FURTHER_KEY_COUNT = {
    THESIS_FORMAT: 0,
    EYELIDS_FORMAT: 4,
    DEFAULT_FORMAT: 0,
    PROGRESSIVE_FORMAT: 2,
    EXTENSIBLE_FORMAT: 3,
    VOICE_FORMAT: 5,
    ASPECT_FORMAT: 6,
    PICTURE_RESIDUAL_FORMAT: 7,
}


def _format_of(packet: ModelPacket) -> int:
    if packet.call.has_residual:
        return PICTURE_RESIDUAL_FORMAT
    if packet.call.sample_aspect != 1:
        return ASPECT_FORMAT
    if packet.call.voice != "off":
        return VOICE_FORMAT
    if packet.call.has_eyelids:
        return EYELIDS_FORMAT
    if packet.extensible:
        return EXTENSIBLE_FORMAT
    if packet.progressive or packet.call.frame_step != 1:
        return PROGRESSIVE_FORMAT
    return THESIS_FORMAT if packet.call.profile == "thesis" else DEFAULT_FORMAT


def _keys(format_number: int) -> tuple[str, ...]:
    return _KEYS + _FURTHER_KEYS[: _FURTHER_KEY_COUNT[format_number]]


def _model_fields(packet: ModelPacket) -> dict[str, Any]:
    call, format_number = packet.call, _format_of(packet)
    values = (
        PROFILES.index(call.profile) + len(PROFILES) * COLOUR_MATRICES.index(call.colour_matrix),
        (call.width, call.height),
        (call.fps_numerator, call.fps_denominator),
        call.focal_px,
        call.frames_per_packet,
        call.start_frame,
        (packet.version, packet.version_count),
        _bytes_from_codes(packet.aau),
        _bytes_from_residual(format_number, packet.residual),
        packet.reference_rotation,
        packet.reference_translation_mm,
        _bytes_from_codes(packet.reference_eau),
        packet.background,
        packet.texture,
        packet.profile_data,
        call.frame_step,
        packet.progressive,
        packet.extensible,
        call.has_eyelids,
        VOICE_NUMBERS[call.voice],
        call.sample_aspect.as_integer_ratio(),
        call.has_residual,
    )
    return dict(zip(_keys(format_number), values, strict=False))


def serialise_model(packet: ModelPacket) -> bytes:
    """The payload of a model packet: format number and fields."""
    fields: bytes = msgpack.packb(_model_fields(packet), use_single_float=True)
    return bytes([_format_of(packet)]) + fields


def parse_model(sequence: int, payload: bytes) -> ModelPacket:
    """The model packet of this sequence number and payload.

    Raises `ValueError` if the payload is not the one encoding of a valid packet.
    """
    format_number = payload[0] if payload else None
    if format_number not in FORMATS:
        raise ValueError(
            f"format version is {'missing' if format_number is None else format_number},"
            f" this program reads {', '.join(map(str, FORMATS))}"
        )
    fields = msgpack.unpackb(
        payload[1:],
        use_list=False,
        max_str_len=1,
        max_bin_len=MAX_IMAGE_BYTES,
        max_array_len=4,
        max_map_len=len(_keys(format_number)),
        max_ext_len=0,
    )
    packet = _model_from_fields(sequence, format_number, fields)
    if format_number == THESIS_FORMAT and packet.call.profile != "thesis":
        raise ValueError(
            f"format version is {format_number}, of the default profile this program reads"
            f" {', '.join(map(str, _DEFAULT_FORMATS))}"
        )
    # MessagePack has several encodings of most values; one of them is valid here.
    if serialise_model(packet) != payload:
        raise ValueError("not in the one encoding of its fields")
    return packet


def _model_from_fields(sequence: int, format_number: int, fields: Any) -> ModelPacket:
    keys = _keys(format_number)
    if not isinstance(fields, dict) or tuple(fields) != keys:
        raise ValueError(f"no map of the fields {','.join(keys)}")
    profile, size, fps, focal, packing, start, versions, aau, residual, *rest = fields.values()
    rotation, translation, eau, background, texture, profile_data, *further = rest
    step, progressive, extensible, has_eyelids, voice, aspect, has_residual = (
        *further,
        *_DEFAULTS[len(further) :],
    )
    check_int("profile and matrix", profile, 0, len(PROFILES) * len(COLOUR_MATRICES) - 1)
    matrix, profile = divmod(profile, len(PROFILES))
    width, height = _pair("size", size)
    numerator, denominator = _pair("fps", fps)
    version, version_count = _pair("model version", versions)
    return ModelPacket(
        call=CallParameters(
            PROFILES[profile],
            width,
            height,
            numerator,
            denominator,
            focal,
            packing,
            start,
            step,
            has_eyelids,
            COLOUR_MATRICES[matrix],
            voice_of(voice),
            aspect_of(*_pair("sample aspect ratio", aspect)),
            has_residual,
        ),
        aau=_codes_from_bytes("aau", aau),
        reference_rotation=rotation,
        reference_translation_mm=translation,
        reference_eau=_codes_from_bytes("reference eau", eau),
        background=background,
        texture=texture,
        residual=_residual_from_bytes(format_number, residual),
        profile_data=profile_data,
        version=version,
        version_count=version_count,
        sequence=sequence,
        progressive=progressive,
        extensible=extensible,
    )


def _pair(name: str, value: Any) -> tuple[Any, Any]:
    if not isinstance(value, tuple) or len(value) != 2:
        raise ValueError(f"{name} is {value!r}, expected two numbers")
    return value


def _bytes_from_residual(format_number: int, codes: tuple[int, ...]) -> bytes:
    return (
        _bytes_from_codes(codes) if format_number in _THESIS_FORMATS else serialise_residual(codes)
    )


def _residual_from_bytes(format_number: int, data: Any) -> tuple[int, ...]:
    if format_number in _THESIS_FORMATS:
        return _codes_from_bytes("residual", data)
    check_bytes("residual", data, MAX_RESIDUAL_BYTES)
    return parse_residual(data)


def _bytes_from_codes(codes: tuple[int, ...]) -> bytes:
    return struct.pack(f"{len(codes)}b", *codes)


def _codes_from_bytes(name: str, data: Any) -> tuple[int, ...]:
    check_bytes(name, data, 3 * MAX_RESIDUAL_POINTS)
    return struct.unpack(f"{len(data)}b", data)


def serialise_residual(codes: tuple[int, ...]) -> bytes:
    """The number of points, then the codes -128..127 of each point's x, y and z; or no bytes."""
    coder, integers = RangeEncoder(), AdaptiveIntegers(AXES)
    for index, code in enumerate(codes):
        integers.code(coder, index % AXES, code)
    return bytes([len(codes) // AXES]) + coder.finish() if codes else b""


def parse_residual(data: bytes) -> tuple[int, ...]:
    """The inverse of `serialise_residual`.  Raises `ValueError` if `data` is damaged."""
    if not data:
        return ()
    coder, integers = RangeDecoder(data[1:]), AdaptiveIntegers(AXES)
    codes = tuple(integers.code(coder, index % AXES, 0) for index in range(AXES * data[0]))
    if coder.unread_bytes:
        raise ValueError(f"residual has {coder.unread_bytes} bytes too many")
    return codes
