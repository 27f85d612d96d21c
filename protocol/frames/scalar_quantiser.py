"""Real values to integer codes and back: the one table of ranges and steps of the thesis profile.

The thesis profile sends ten values of eight bits ten times a second (thesis 5.1): the head's motion
against the reference pose, and four EAUs; if the call says so, two more for the lids.  Codes
-127..127 are companded, value = sign(c) (a|c| + b c^2), so that small motions are precise and large
ones possible.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.packets import ProtocolError
from shared_model.geometry import (
    conjugate,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import EAU_INDEX, EAUS, LID_EAUS, THESIS_EAUS, FaceParameters, Pose

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

# Steps of the codes -128..127 in a model packet.
AAU_STEP = 1 / 64
EAU_STEP = 1 / 127
RESIDUAL_STEP_MM = 0.25

MAX_CODE = 127
THESIS_RATE_HZ = 10


@dataclass(frozen=True, slots=True)
class Scale:
    """How one value of the thesis profile is companded around `centre`.

    finest: value of one code at rest (a); reach: value at code 127, measured from `centre`.
    """

    name: str
    unit: str
    finest: float
    reach: float
    centre: float = 0.0

    @property
    def growth(self) -> float:
        """b of value = a|c| + b c^2."""
        return (self.reach - MAX_CODE * self.finest) / MAX_CODE**2


def _linear(name: str) -> Scale:
    eau = EAUS[EAU_INDEX[name]]
    reach = (eau.high - eau.low) / 2
    return Scale(name, "1", reach / MAX_CODE, reach, eau.low + reach)


# Rotation is the axis-angle vector from the reference rotation, camera axes.  Shift is that of the
# projected head origin, carried back to the reference's depth: it is in mm and needs no camera.
# Depth is the natural logarithm of the depth over the reference's.  Lids are last: a call without
# them sends the rows before.
THESIS_TABLE = (
    Scale("rotation_x", "deg", 0.2, 60.0),
    Scale("rotation_y", "deg", 0.2, 60.0),
    Scale("rotation_z", "deg", 0.2, 60.0),
    Scale("shift_right", "mm", 0.3, 300.0),
    Scale("shift_down", "mm", 0.3, 300.0),
    Scale("depth", "log", 0.001, 1.0),
    *(_linear(name) for name in (*THESIS_EAUS, *LID_EAUS)),
)

_FINEST = np.array([scale.finest for scale in THESIS_TABLE])
_GROWTH = np.array([scale.growth for scale in THESIS_TABLE])
_CENTRE = np.array([scale.centre for scale in THESIS_TABLE])
_MOTION = 6


def sent_eaus(lids: bool) -> tuple[str, ...]:
    """The actuators that frame packets of the thesis profile carry, with the lids or without."""
    return (*THESIS_EAUS, *LID_EAUS) if lids else THESIS_EAUS


def encode_thesis(parameters: FaceParameters, reference: Pose, lids: bool = False) -> bytes:
    """Payload of a thesis frame packet: one byte per row of `THESIS_TABLE` sent, code + 128."""
    return bytes((codes_from_parameters(parameters, reference, lids) + 128).astype(np.uint8))


def decode_thesis(payload: bytes, reference: Pose, lids: bool = False) -> FaceParameters:
    """The face of a thesis frame packet.

    Raises `ProtocolError` if it is not ten valid codes, with lids twelve.
    """
    expected = _MOTION + len(sent_eaus(lids))
    if len(payload) != expected:
        raise ProtocolError(f"thesis frame has {len(payload)} bytes, expected {expected}")
    if 0 in payload:
        raise ProtocolError("thesis frame has a code of -128, expected -127..127")
    return parameters_from_codes(np.frombuffer(payload, np.uint8).astype(np.int64) - 128, reference)


def codes_from_parameters(parameters: FaceParameters, reference: Pose, lids: bool = False) -> Codes:
    """(10,) int64 codes -127..127 of `THESIS_TABLE`, with lids (12,); beyond the range clipped."""
    motion = motion_from_pose(parameters.pose, reference)
    sent = np.concatenate([motion, parameters.eau[_places(lids)]])
    values, finest, growth = sent - _CENTRE[: len(sent)], _FINEST[: len(sent)], _GROWTH[: len(sent)]
    size = np.abs(values)
    # The root of a c + b c^2 = size that suffers no cancellation where b is 0 or tiny.
    root = 2 * size / (finest + np.sqrt(finest**2 + 4 * growth * size))
    below = np.floor(root)
    codes = below + (size - _expand(below) > _expand(below + 1) - size)
    signed = np.sign(values) * np.minimum(codes, MAX_CODE)
    return np.asarray(signed, dtype=np.int64)


def parameters_from_codes(codes: Codes, reference: Pose) -> FaceParameters:
    """The face that (10,) codes, or (12,) with lids, stand for; EAUs that are not sent are 0."""
    values = np.sign(codes) * _expand(np.abs(codes).astype(np.float64)) + _CENTRE[: len(codes)]
    eau = np.zeros(len(EAUS))
    eau[_places(len(codes) == len(THESIS_TABLE))] = values[_MOTION:]
    return FaceParameters(pose_from_motion(values[:_MOTION], reference), eau)


def motion_from_pose(pose: Pose, reference: Pose) -> Array:
    """(6,) rotation (deg), shift (mm) and depth (log) of the first rows of `THESIS_TABLE`."""
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
    """Samples due once `frames` source frames have come: those at k / 10 s up to the last frame."""
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
    return _FINEST[: len(size)] * size + _GROWTH[: len(size)] * size**2


def _places(lids: bool) -> list[int]:
    return [EAU_INDEX[name] for name in sent_eaus(lids)]
