"""The default profile's data of the model packet: appearance modes and the frame transform.

The parameters of a frame (motion, EAUs, coefficients of layers and modes) are one vector
y = mean + (q @ basis) * unit.  Its coefficients q, the combined components of thesis eq. 2.18-2.19,
are what frame packets carry; one unit of each adds equal distortion to the picture.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.frames.scalar_quantiser import motion_from_pose, pose_from_motion
from protocol.frames.temporal_prediction import MAX_SCALE_CODE, PREDICTION_KINDS, STEPS_PER_UNIT
from shared_model.arrays import Array, Integers, Picture
from shared_model.parameters import EAUS, FaceParameters, Pose, clip_eau

GEOMETRY_SIZE = 6 + len(EAUS)
MAX_MODES = 64
# Layer coefficients, see `protocol.pictures.layered_background`.
MAX_LAYER_COEFFICIENTS = 16
UNIT_CODES_PER_OCTAVE, UNIT_CODE_OF_ONE = 8, 128
MEAN_STEPS_PER_UNIT = 4
MAX_MEAN_CODE = (2 << AdaptiveIntegers.LONGEST) - 2
MAX_BASIS_CODE = 127
MAX_EXPONENT = 20
# Scale codes are multiples of this: finer ones saved no bits of frames.
SCALE_CODE_STEP = 2
# A coefficient of 1 of a reserved mode changes the picture by about so many grey levels.
RESERVED_MODE_GREY = 2.0
RESERVED_UNIT_CODE = UNIT_CODE_OF_ONE - UNIT_CODES_PER_OCTAVE
RESERVED_SCALE_CODES = (22, 22, 18, 16, 12)
# Bounds of a decoded frame: any parameter, then rotation (deg), shift (mm) and log depth.
MAX_PARAMETER = 1e5
MAX_MOTION = (180.0, 180.0, 180.0, 1e4, 1e4, 3.0)


@dataclass(frozen=True, slots=True)
class FrameTransform:
    """The transform from n coefficients to d = 6 + EAUs + layers + modes parameters.

    modes: encoded appearance modes, see `picture_codec.ModeCodec`; the texture of a frame is the
        mean texture plus each mode times its coefficient (eq. 2.17).  An empty mode, which has not
        been received yet, adds nothing.
    unit_codes: (d,) uint8, the unit of each parameter, eighths of an octave above 2 ** -16.
    mean_codes: (d,) int, the mean of y in quarters of its units: motion relative to the reference
        pose (rotation deg, shift mm, log depth), EAUs, coefficients of layers, then of modes.
    basis: (n, d) int8, in 1 / `MAX_BASIS_CODE` of the units, times 2 ** exponent by row.
    exponents: (n,) int8, -MAX_EXPONENT..MAX_EXPONENT.
    scale_codes: (n, PREDICTION_KINDS) uint8, multiples of `SCALE_CODE_STEP` in 0..MAX_SCALE_CODE,
        see `temporal_prediction.FramePredictor`.
    reserved_modes: so many of the last modes may be empty and are sent during the call; each has a
        component of its own, and these are the last components.
    layers: number of layer coefficients.
    """

    modes: tuple[bytes, ...]
    unit_codes: Picture
    mean_codes: Integers
    basis: NDArray[np.int8]
    exponents: NDArray[np.int8]
    scale_codes: Picture
    reserved_modes: int = 0
    layers: int = 0

    def __post_init__(self) -> None:
        d, n = GEOMETRY_SIZE + self.layers + len(self.modes), len(self.basis)
        if not 0 <= self.layers <= MAX_LAYER_COEFFICIENTS:
            raise ValueError(f"{self.layers} layer coefficients, limit {MAX_LAYER_COEFFICIENTS}")
        if len(self.modes) > MAX_MODES or not 1 <= n <= max_components(self.layers):
            raise ValueError(f"{len(self.modes)} modes and {n} components, limit {MAX_MODES}")
        if not 0 <= self.reserved_modes <= min(len(self.modes), n - 1):
            raise ValueError(
                f"{self.reserved_modes} reserved modes of {len(self.modes)}, {n} components"
            )
        shapes = (self.unit_codes.shape, self.mean_codes.shape, self.basis.shape)
        if shapes != ((d,), (d,), (n, d)) or self.exponents.shape != (n,):
            raise ValueError(
                f"shapes {shapes} of units, means and basis, expected d = {d}, n = {n}"
            )
        if (
            self.scale_codes.shape != (n, PREDICTION_KINDS)
            or self.scale_codes.max() > MAX_SCALE_CODE
        ):
            raise ValueError(
                f"scale codes {self.scale_codes.shape},"
                f" expected {(n, PREDICTION_KINDS)} of 0..{MAX_SCALE_CODE}"
            )
        if (self.scale_codes % SCALE_CODE_STEP).any():
            raise ValueError(f"scale codes are no multiples of {SCALE_CODE_STEP}")
        if (np.abs(self.mean_codes) > MAX_MEAN_CODE).any():
            raise ValueError(f"mean beyond {MAX_MEAN_CODE}")
        if (np.abs(self.basis.astype(int)) > MAX_BASIS_CODE).any():
            raise ValueError(f"basis beyond {MAX_BASIS_CODE}")
        if (np.abs(self.exponents.astype(int)) > MAX_EXPONENT).any():
            raise ValueError(f"exponent beyond {MAX_EXPONENT}")

    @property
    def units(self) -> Array:
        """(d,) change of each parameter that adds equal distortion, > 0."""
        return units_from_codes(self.unit_codes)

    @property
    def mean(self) -> Array:
        """(d,) the mean of y."""
        return np.asarray(self.mean_codes * self.units / MEAN_STEPS_PER_UNIT)

    @property
    def matrix(self) -> Array:
        """(n, d) what one unit of each component adds to y."""
        rows = np.ldexp(
            self.basis.astype(np.float64) / MAX_BASIS_CODE, self.exponents.astype(int)[:, None]
        )
        return np.asarray(rows * self.units)


def max_components(layers: int) -> int:
    """The most components of a transform with so many layer coefficients."""
    return GEOMETRY_SIZE + layers + MAX_MODES


def with_reserved_modes(transform: FrameTransform, count: int) -> FrameTransform:
    """The transform with `count` more reserved modes.  Raises `ValueError` beyond `MAX_MODES`."""
    basis = transform.basis
    n, d = basis.shape
    wide = np.zeros((n + count, d + count), np.int8)
    wide[:n, :d] = basis
    wide[range(n, n + count), range(d, d + count)] = MAX_BASIS_CODE
    return FrameTransform(
        modes=transform.modes + (b"",) * count,
        unit_codes=np.append(transform.unit_codes, np.full(count, RESERVED_UNIT_CODE, np.uint8)),
        mean_codes=np.append(transform.mean_codes, np.zeros(count, np.int64)),
        basis=wide,
        exponents=np.append(transform.exponents, np.zeros(count, np.int8)),
        scale_codes=np.concatenate(
            [transform.scale_codes, np.tile(np.array(RESERVED_SCALE_CODES, np.uint8), (count, 1))]
        ),
        reserved_modes=transform.reserved_modes + count,
        layers=transform.layers,
    )


def without_reserved_modes(transform: FrameTransform, keep: int = 0) -> FrameTransform:
    """The transform whose modes end with the first `keep` reserved ones; none remains reserved."""
    dropped = transform.reserved_modes - keep
    n, d = (side - dropped for side in transform.basis.shape)
    return FrameTransform(
        modes=transform.modes[: len(transform.modes) - dropped],
        unit_codes=transform.unit_codes[:d],
        mean_codes=transform.mean_codes[:d],
        basis=transform.basis[:n, :d],
        exponents=transform.exponents[:n],
        scale_codes=transform.scale_codes[:n],
        layers=transform.layers,
    )


def face_from_coefficients(
    transform: FrameTransform, coded: Integers, reference: Pose
) -> FaceParameters:
    """The face of one frame.

    coded: (n,) integers, coefficients in 1 / `STEPS_PER_UNIT` of a unit.
    Any integers give finite motion and mode coefficients, and actuators within their ranges.
    """
    y = transform.mean + (coded / STEPS_PER_UNIT) @ transform.matrix
    y = np.clip(y, -MAX_PARAMETER, MAX_PARAMETER)
    limit = np.array(MAX_MOTION)
    pose = pose_from_motion(np.clip(y[:6], -limit, limit), reference)
    first_mode = GEOMETRY_SIZE + transform.layers
    eau, layers, modes = np.split(y[6:], [GEOMETRY_SIZE - 6, first_mode - 6])
    return FaceParameters(pose, clip_eau(eau), modes, layers)


def vector_from_face(face: FaceParameters, reference: Pose) -> Array:
    """The parameters y (d,) of a face: the inverse of `face_from_coefficients`."""
    motion = motion_from_pose(face.pose, reference)
    return np.concatenate([motion, face.eau, face.layers, face.modes])


def units_from_codes(codes: Picture) -> Array:
    """(d,) units of unit codes."""
    return np.asarray(
        2.0 ** ((codes.astype(np.float64) - UNIT_CODE_OF_ONE) / UNIT_CODES_PER_OCTAVE)
    )


def codes_from_units(unit: Array) -> Picture:
    """(d,) unit codes of the nearest units."""
    codes = np.rint(UNIT_CODES_PER_OCTAVE * np.log2(unit)) + UNIT_CODE_OF_ONE
    return np.asarray(np.clip(codes, 0, 255), np.uint8)
