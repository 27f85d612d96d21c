"""The default profile's part of the model packet: appearance modes and combined components.

A frame is y = centre + (q @ basis) * unit: pose, EAUs and mode coefficients are one vector, and
what is sent are its combined components (thesis eq. 2.18-2.19), scaled so that one unit of any of
them does equal harm to the picture.
"""

from dataclasses import dataclass
from typing import Any

import msgpack  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from protocol.messages import MAX_IMAGE_BYTES, ProtocolError
from protocol.predict import KINDS, MAX_SPREAD, UNIT, Integers
from protocol.quantise import motion_from_pose, pose_from_motion
from shared_model.parameters import EAUS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]

GEOMETRY = 6 + len(EAUS)
MAX_MODES = 64
MAX_COMPONENTS = GEOMETRY + MAX_MODES
_KEYS = ("m", "c", "u", "b", "s")


@dataclass(frozen=True, slots=True)
class Components:
    """How frames of the default profile become faces; d = 6 + EAUs + modes values, n components.

    modes: encoded pictures of the appearance modes, each 128 + mode, added to the texture times its
        coefficient (eq. 2.17).
    centre: (d,) float32, the mean of y: motion against the reference pose as in the thesis profile
        (rotation deg, shift mm, log depth), EAUs, mode coefficients.
    unit: (d,) float32, > 0.  basis: (n, d) int8, in 1 / 127 of `unit`, times 2 ** exponent by row.
    exponents: (n,) int8.
    spreads: (n, KINDS) uint8 0..MAX_SPREAD, see `predict.FramePredictor`.
    """

    modes: tuple[bytes, ...]
    centre: NDArray[np.float32]
    unit: NDArray[np.float32]
    basis: NDArray[np.int8]
    exponents: NDArray[np.int8]
    spreads: NDArray[np.uint8]

    def __post_init__(self) -> None:
        d, n = GEOMETRY + len(self.modes), len(self.basis)
        if len(self.modes) > MAX_MODES or not 1 <= n <= MAX_COMPONENTS:
            raise ValueError(f"{len(self.modes)} modes and {n} components, limit {MAX_MODES}")
        shapes = (self.centre.shape, self.unit.shape, self.basis.shape)
        if shapes != ((d,), (d,), (n, d)) or self.exponents.shape != (n,):
            raise ValueError(
                f"shapes {shapes} of centre, unit and basis, expected d = {d}, n = {n}"
            )
        if self.spreads.shape != (n, KINDS) or self.spreads.max() > MAX_SPREAD:
            raise ValueError(
                f"spreads {self.spreads.shape}, expected {(n, KINDS)} of 0..{MAX_SPREAD}"
            )
        if not (np.isfinite(self.centre).all() and (np.abs(self.centre) < 1e5).all()):
            raise ValueError("centre is not finite and below 1e5")
        if not (np.isfinite(self.unit).all() and (self.unit > 0).all() and (self.unit < 1e5).all()):
            raise ValueError("unit is not in 0..1e5")
        if (np.abs(self.exponents.astype(int)) > 20).any():
            raise ValueError("exponent beyond 20")

    @property
    def matrix(self) -> Array:
        """(n, d) what one unit of each component adds to y."""
        rows = np.ldexp(self.basis.astype(np.float64) / 127, self.exponents.astype(int)[:, None])
        return np.asarray(rows * self.unit)


def face_from_components(
    components: Components, coded: Integers, reference: Pose
) -> FaceParameters:
    """The face of one frame.  coded: (n,) integers, in 1 / `UNIT` unit.

    Whatever the integers, motion and coefficients stay finite and actuators in their ranges.
    """
    y = components.centre + (coded / UNIT) @ components.matrix
    y = np.clip(y, -1e5, 1e5)
    limit = np.array([180.0, 180.0, 180.0, 1e4, 1e4, 3.0])
    pose = pose_from_motion(np.clip(y[:6], -limit, limit), reference)
    return FaceParameters(pose, clip_eau(y[6:GEOMETRY]), y[GEOMETRY:])


def vector_from_face(face: FaceParameters, reference: Pose) -> Array:
    """y (d,) of a face, the inverse of `face_from_components` before quantisation."""
    return np.concatenate([motion_from_pose(face.pose, reference), face.eau, face.modes])


def serialise_components(components: Components) -> bytes:
    """The bytes of the model packet's extension."""
    arrays = (components.centre, components.unit, components.basis)
    tables = (components.exponents, components.spreads)
    raw = [a.astype(a.dtype.newbyteorder("<")).tobytes() for a in (*arrays[:2],)]
    raw += [components.basis.tobytes()]
    raw += [tables[0].tobytes() + tables[1].tobytes()]
    data: bytes = msgpack.packb(dict(zip(_KEYS, (components.modes, *raw), strict=True)))
    return data


def parse_components(data: bytes) -> Components:
    """The components in an extension.  Raises `ProtocolError` if it holds none."""
    try:
        fields: Any = msgpack.unpackb(
            data,
            use_list=False,
            max_str_len=1,
            max_bin_len=MAX_IMAGE_BYTES,
            max_array_len=MAX_MODES,
            max_map_len=len(_KEYS),
            max_ext_len=0,
        )
        return _components(fields)
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"model packet's components: {error}"[:200]) from error


def _components(fields: Any) -> Components:
    modes, centre, unit, basis, tables = (fields[key] for key in _KEYS)
    if not isinstance(modes, tuple) or not all(isinstance(mode, bytes) for mode in modes):
        raise ValueError("modes are not byte strings")
    d = GEOMETRY + len(modes)
    rows = np.frombuffer(basis, np.int8)
    n = len(rows) // d
    flat = np.frombuffer(tables, np.uint8)
    return Components(
        modes,
        np.frombuffer(centre, "<f4").astype(np.float32),
        np.frombuffer(unit, "<f4").astype(np.float32),
        rows.reshape(n, d),
        flat[:n].view(np.int8),
        flat[n:].reshape(n, KINDS),
    )
