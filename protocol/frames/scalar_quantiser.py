"""Scalar quantisers: codes of model packets and the companded codes of the thesis profile.

The thesis profile sends ten values of eight bits ten times a second (thesis 5.1): the head's motion
relative to the reference pose, and four EAUs; with eyelids, two more.  Codes -127..127 are
companded, value = centre + sign(c) (a |c| + b c^2): small motions are precise and the range is
large.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.errors import ProtocolError
from shared_model.arrays import Array, Integers
from shared_model.geometry import (
    conjugate,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import EAU_INDEX, EAUS, LID_EAUS, THESIS_EAUS, FaceParameters, Pose

# Steps of the codes -128..127 in a model packet.
AAU_STEP = 1 / 64
EAU_STEP = 1 / 127
RESIDUAL_STEP_MM = 0.25

MAX_CODE = 127
THESIS_RATE_HZ = 10


@dataclass(frozen=True, slots=True)
class CompandedScale:
    """The quantiser of one value of the thesis profile.

    slope: a, the step at code 0.
    range: distance of the values of codes +-127 from `centre`.
    """

    name: str
    unit: str
    slope: float
    range: float
    centre: float = 0.0

    @property
    def curvature(self) -> float:
        """b, by which the step grows with the code."""
        return (self.range - MAX_CODE * self.slope) / MAX_CODE**2


def _linear(name: str) -> CompandedScale:
    eau = EAUS[EAU_INDEX[name]]
    half_range = (eau.high - eau.low) / 2
    return CompandedScale(name, "1", half_range / MAX_CODE, half_range, eau.low + half_range)


# Rotation is the axis-angle vector from the reference rotation, camera axes.  Shift is the
# displacement of the head origin's projection, scaled to the depth of the reference: it is in mm
# and independent of the camera.  Depth is the natural logarithm of depth over reference depth.
# The rows of the eyelids are last; a call without eyelids sends the rows before them.
THESIS_TABLE = (
    CompandedScale("rotation_x", "deg", 0.2, 60.0),
    CompandedScale("rotation_y", "deg", 0.2, 60.0),
    CompandedScale("rotation_z", "deg", 0.2, 60.0),
    CompandedScale("shift_right", "mm", 0.3, 300.0),
    CompandedScale("shift_down", "mm", 0.3, 300.0),
    CompandedScale("depth", "log", 0.001, 1.0),
    *(_linear(name) for name in (*THESIS_EAUS, *LID_EAUS)),
)

_SLOPE = np.array([scale.slope for scale in THESIS_TABLE])
_CURVATURE = np.array([scale.curvature for scale in THESIS_TABLE])
_CENTRE = np.array([scale.centre for scale in THESIS_TABLE])
_MOTION_SIZE = 6


def sent_eaus(with_eyelids: bool) -> tuple[str, ...]:
    """Names of the actuators in frame packets of the thesis profile."""
    return (*THESIS_EAUS, *LID_EAUS) if with_eyelids else THESIS_EAUS


def encode_thesis(parameters: FaceParameters, reference: Pose, with_eyelids: bool = False) -> bytes:
    """Payload of a thesis frame packet: code + 128 as a byte, by the rows of `THESIS_TABLE`."""
    return bytes(
        (codes_from_parameters(parameters, reference, with_eyelids) + 128).astype(np.uint8)
    )


def decode_thesis(payload: bytes, reference: Pose, with_eyelids: bool = False) -> FaceParameters:
    """The face of a thesis frame packet.

    Raises `ProtocolError` unless the payload is ten valid codes, with eyelids twelve.
    """
    expected = _MOTION_SIZE + len(sent_eaus(with_eyelids))
    if len(payload) != expected:
        raise ProtocolError(f"thesis frame has {len(payload)} bytes, expected {expected}")
    if 0 in payload:
        raise ProtocolError("thesis frame has a code of -128, expected -127..127")
    return parameters_from_codes(np.frombuffer(payload, np.uint8).astype(np.int64) - 128, reference)


def codes_from_parameters(
    parameters: FaceParameters, reference: Pose, with_eyelids: bool = False
) -> Integers:
    """(10,) int64 codes -127..127 by `THESIS_TABLE`, with eyelids (12,); values are clipped."""
    motion = motion_from_pose(parameters.pose, reference)
    sent = np.concatenate([motion, parameters.eau[_sent_indices(with_eyelids)]])
    values, slope, curvature = (
        sent - _CENTRE[: len(sent)],
        _SLOPE[: len(sent)],
        _CURVATURE[: len(sent)],
    )
    size = np.abs(values)
    # This form of the root of a c + b c^2 = size has no cancellation where b is 0 or small.
    root = 2 * size / (slope + np.sqrt(slope**2 + 4 * curvature * size))
    below = np.floor(root)
    codes = below + (size - _expand(below) > _expand(below + 1) - size)
    signed = np.sign(values) * np.minimum(codes, MAX_CODE)
    return np.asarray(signed, dtype=np.int64)


def parameters_from_codes(codes: Integers, reference: Pose) -> FaceParameters:
    """The face of codes (10,), or (12,) with eyelids; EAUs that are not sent are 0."""
    values = np.sign(codes) * _expand(np.abs(codes).astype(np.float64)) + _CENTRE[: len(codes)]
    eau = np.zeros(len(EAUS))
    eau[_sent_indices(len(codes) == len(THESIS_TABLE))] = values[_MOTION_SIZE:]
    return FaceParameters(pose_from_motion(values[:_MOTION_SIZE], reference), eau)


def motion_from_pose(pose: Pose, reference: Pose) -> Array:
    """(6,) rotation (deg), shift (mm) and depth (log) relative to `reference`: `THESIS_TABLE`."""
    turn = multiply(pose.rotation, conjugate(reference.rotation))
    x, y, z = pose.translation_mm
    x_ref, y_ref, z_ref = reference.translation_mm
    shift = [x / z * z_ref - x_ref, y / z * z_ref - y_ref, np.log(z / z_ref)]
    return np.concatenate([np.degrees(vector_from_quaternion(turn)), shift])


def pose_from_motion(motion: Array, reference: Pose) -> Pose:
    """The inverse of `motion_from_pose`."""
    turn = quaternion_from_vector(np.radians(motion[:3]))
    ratio = np.exp(motion[5])
    x_ref, y_ref, z_ref = reference.translation_mm
    translation = ratio * np.array([x_ref + motion[3], y_ref + motion[4], z_ref])
    return Pose(normalise(multiply(turn, reference.rotation)), translation)


def thesis_sample_count(frames: int, fps_numerator: int, fps_denominator: int) -> int:
    """Number of samples at times k / 10 s up to the last of `frames` source frames."""
    if frames < 1:
        return 0
    return (frames - 1) * THESIS_RATE_HZ * fps_denominator // fps_numerator + 1


def codes_from_values(values: Array, step: float, low: int = -128) -> tuple[int, ...]:
    """Nearest codes low..127 of `values` (any shape, flattened) in steps of `step`."""
    codes = np.clip(np.rint(np.asarray(values) / step), low, MAX_CODE)
    return tuple(int(code) for code in codes.ravel())


def values_from_codes(codes: Sequence[int], step: float) -> Array:
    """(len(codes),) values of codes in steps of `step`."""
    return np.array(codes, dtype=np.float64) * step


def _expand(size: Array) -> Array:
    return _SLOPE[: len(size)] * size + _CURVATURE[: len(size)] * size**2


def _sent_indices(with_eyelids: bool) -> list[int]:
    return [EAU_INDEX[name] for name in sent_eaus(with_eyelids)]
