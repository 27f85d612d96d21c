"""The default profile's part of the model packet: appearance modes and combined components.

A frame is y = centre + (q @ basis) * unit: pose, EAUs and mode coefficients are one vector, and
what is sent are its combined components (thesis eq. 2.18-2.19), scaled so that one unit of any of
them does equal harm to the picture.
"""

from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

import msgpack  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.entropy.validation import check_int
from protocol.frames.scalar_quantiser import motion_from_pose, pose_from_motion
from protocol.frames.temporal_prediction import KINDS, MAX_SPREAD, UNIT, Integers
from protocol.frames.value_coding import BitCoder
from protocol.packets import MAX_IMAGE_BYTES, ProtocolError
from shared_model.parameters import EAUS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]

GEOMETRY = 6 + len(EAUS)
MAX_MODES = 64
MAX_COMPONENTS = GEOMETRY + MAX_MODES
_KEYS = ("m", "t")
_SPARE_KEY = "s"
# Steps of a unit to the octave, the code of 1, and steps of the centre to a unit.
UNIT_STEPS, UNIT_ZERO = 8, 128
CENTRE_STEPS = 4
MAX_CENTRE = (2 << AdaptiveIntegers.LONGEST) - 2
MAX_BASIS = 127
SPREAD_STEP = 2
# Coefficient 1 of a spare mode changes the picture by about this much, grey levels; the code of the
# unit that goes with it; the usual sizes of what predictions leave, see `Components.spreads`.
SPARE_HARM_GREY = 2.0
SPARE_UNIT = UNIT_ZERO - UNIT_STEPS
SPARE_SPREADS = (22, 22, 18, 16, 12)


@dataclass(frozen=True, slots=True)
class Components:
    """How frames of the default profile become faces; d = 6 + EAUs + modes values, n components.

    modes: coded appearance modes, see `pictures.ModeSeries`; each is added to the texture times its
        coefficient (eq. 2.17).  One that has not come yet is empty and adds nothing.
    units: (d,) uint8, the `unit` of each value in eighths of an octave above 2 ** -16.
    centres: (d,) int, the mean of y in quarters of `unit`: motion against the reference pose as in
        the thesis profile (rotation deg, shift mm, log depth), EAUs, mode coefficients.
    basis: (n, d) int8, in 1 / `MAX_BASIS` of `unit`, times 2 ** exponent by row.
    exponents: (n,) int8.
    spreads: (n, KINDS) uint8 0..MAX_SPREAD, see `predict.FramePredictor`; multiples of
        `SPREAD_STEP`, finer ones would save no bits of frames.
    spare: so many of the last modes are learned while the call goes on and come in layers; each has
        a component of its own, the last ones.
    """

    modes: tuple[bytes, ...]
    units: NDArray[np.uint8]
    centres: Integers
    basis: NDArray[np.int8]
    exponents: NDArray[np.int8]
    spreads: NDArray[np.uint8]
    spare: int = 0

    def __post_init__(self) -> None:
        d, n = GEOMETRY + len(self.modes), len(self.basis)
        if len(self.modes) > MAX_MODES or not 1 <= n <= MAX_COMPONENTS:
            raise ValueError(f"{len(self.modes)} modes and {n} components, limit {MAX_MODES}")
        if not 0 <= self.spare <= min(len(self.modes), n - 1):
            raise ValueError(f"{self.spare} spare modes of {len(self.modes)}, {n} components")
        shapes = (self.units.shape, self.centres.shape, self.basis.shape)
        if shapes != ((d,), (d,), (n, d)) or self.exponents.shape != (n,):
            raise ValueError(
                f"shapes {shapes} of units, centres and basis, expected d = {d}, n = {n}"
            )
        if self.spreads.shape != (n, KINDS) or self.spreads.max() > MAX_SPREAD:
            raise ValueError(
                f"spreads {self.spreads.shape}, expected {(n, KINDS)} of 0..{MAX_SPREAD}"
            )
        if (self.spreads % SPREAD_STEP).any():
            raise ValueError(f"spreads are no multiples of {SPREAD_STEP}")
        if (np.abs(self.centres) > MAX_CENTRE).any():
            raise ValueError(f"centre beyond {MAX_CENTRE}")
        if (np.abs(self.basis.astype(int)) > MAX_BASIS).any():
            raise ValueError(f"basis beyond {MAX_BASIS}")
        if (np.abs(self.exponents.astype(int)) > 20).any():
            raise ValueError("exponent beyond 20")

    @property
    def unit(self) -> Array:
        """(d,) what does equal harm, > 0."""
        return unit_of(self.units)

    @property
    def centre(self) -> Array:
        """(d,) the mean of y."""
        return np.asarray(self.centres * self.unit / CENTRE_STEPS)

    @property
    def matrix(self) -> Array:
        """(n, d) what one unit of each component adds to y."""
        rows = np.ldexp(
            self.basis.astype(np.float64) / MAX_BASIS, self.exponents.astype(int)[:, None]
        )
        return np.asarray(rows * self.unit)


def with_spare(components: Components, spare: int) -> Components:
    """The same with room for so many more modes.  Raises `ValueError` if there are too many."""
    basis = components.basis
    n, d = basis.shape
    wide = np.zeros((n + spare, d + spare), np.int8)
    wide[:n, :d] = basis
    wide[range(n, n + spare), range(d, d + spare)] = MAX_BASIS
    return Components(
        modes=components.modes + (b"",) * spare,
        units=np.append(components.units, np.full(spare, SPARE_UNIT, np.uint8)),
        centres=np.append(components.centres, np.zeros(spare, np.int64)),
        basis=wide,
        exponents=np.append(components.exponents, np.zeros(spare, np.int8)),
        spreads=np.concatenate(
            [components.spreads, np.tile(np.array(SPARE_SPREADS, np.uint8), (spare, 1))]
        ),
        spare=components.spare + spare,
    )


def without_spare(components: Components, kept: int = 0) -> Components:
    """The same with only the first `kept` of the spare modes, as if they were none."""
    gone = components.spare - kept
    n, d = (side - gone for side in components.basis.shape)
    return Components(
        modes=components.modes[: len(components.modes) - gone],
        units=components.units[:d],
        centres=components.centres[:d],
        basis=components.basis[:n, :d],
        exponents=components.exponents[:n],
        spreads=components.spreads[:n],
    )


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


def unit_of(codes: NDArray[np.uint8]) -> Array:
    """(d,) units that codes stand for."""
    return np.asarray(2.0 ** ((codes.astype(np.float64) - UNIT_ZERO) / UNIT_STEPS))


def codes_of_units(unit: Array) -> NDArray[np.uint8]:
    """(d,) codes of the nearest units."""
    codes = np.rint(UNIT_STEPS * np.log2(unit)) + UNIT_ZERO
    return np.asarray(np.clip(codes, 0, 255), np.uint8)


def serialise_components(components: Components) -> bytes:
    """The bytes of the model packet's extension.  Spare modes that have not come take none."""
    base, coder = without_spare(components), RangeEncoder()
    _code_tables(coder, base)
    tables = bytes([len(base.basis)]) + coder.finish()
    grown = tuple(takewhile(bool, components.modes[len(base.modes) :]))
    fields: dict[str, Any] = dict(zip(_KEYS, (base.modes + grown, tables), strict=True))
    if components.spare:
        fields[_SPARE_KEY] = (len(grown), components.spare)
    data: bytes = msgpack.packb(fields)
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
            max_map_len=len(_KEYS) + 1,
            max_ext_len=0,
        )
        return _components(fields)
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"model packet's components: {error}"[:200]) from error


def _components(fields: Any) -> Components:
    if unknown := set(fields) - {*_KEYS, _SPARE_KEY}:
        raise ValueError(f"unknown fields {sorted(map(str, unknown))}")
    modes, tables = (fields[key] for key in _KEYS)
    if not isinstance(modes, tuple) or not all(isinstance(mode, bytes) for mode in modes):
        raise ValueError("modes are not byte strings")
    if not isinstance(tables, bytes) or not tables or not 1 <= tables[0] <= MAX_COMPONENTS:
        raise ValueError("no tables")
    grown, spare = _grown(fields, modes)
    known = modes[: len(modes) - grown]
    d, n = GEOMETRY + len(known), tables[0]
    empty = Components(
        known,
        units=np.zeros(d, np.uint8),
        centres=np.zeros(d, np.int64),
        basis=np.zeros((n, d), np.int8),
        exponents=np.zeros(n, np.int8),
        spreads=np.zeros((n, KINDS), np.uint8),
    )
    coder = RangeDecoder(tables[1:])
    found = _code_tables(coder, empty)
    if coder.surplus:
        raise ValueError(f"{coder.surplus} bytes too many")
    roomy = with_spare(found, spare)
    return replace(roomy, modes=modes + roomy.modes[len(modes) :])


def _grown(fields: Any, modes: tuple[bytes, ...]) -> tuple[int, int]:
    """How many of the modes are spare ones that have come, and how many spare ones there are."""
    grown, spare = fields.get(_SPARE_KEY, (0, 0))
    check_int("spare modes", spare, 0, MAX_MODES)
    check_int("spare modes that have come", grown, 0, min(spare, len(modes)))
    return grown, spare


def _code_tables(coder: BitCoder, components: Components) -> Components:
    """Code all but the modes; a decoder takes sizes only from `components`.  Returns them."""
    groups = np.repeat([0, 1, 2], [6, len(EAUS), len(components.modes)])[None]
    spreads = components.spreads.astype(np.int64) // SPREAD_STEP
    # By how much more or less they fall from kind to kind than those of the component before.
    falls = np.diff(np.diff(spreads, axis=1, prepend=0), axis=0, prepend=0).astype(np.int64)
    rises = np.diff(components.units.astype(np.int64), prepend=0).astype(np.int64)
    units = _code_table(coder, rises[None], 1)
    centres = _code_table(coder, components.centres[None], 1)[0]
    basis = _code_table(coder, components.basis.astype(np.int64), 3, groups)
    exponents = _code_table(coder, components.exponents.astype(np.int64)[None], 1)[0]
    falls = _code_table(coder, falls, KINDS, np.arange(KINDS)[None])
    return Components(
        components.modes,
        units=_bytes(np.cumsum(units[0])),
        centres=centres,
        basis=_signed(basis),
        exponents=_signed(exponents),
        spreads=_bytes(SPREAD_STEP * falls.cumsum(0).cumsum(1)),
    )


def _code_table(
    coder: BitCoder, values: Integers, contexts: int, context: Integers | None = None
) -> Integers:
    """Code a table (r, c) of integers.  context: (1, c) of each column, 0..contexts - 1."""
    integers = AdaptiveIntegers(contexts)
    of_column = [0] * values.shape[1] if context is None else context[0].tolist()
    rows = [
        [integers.code(coder, c, v) for c, v in zip(of_column, row, strict=True)]
        for row in values.tolist()
    ]
    return np.array(rows, dtype=np.int64)


def _bytes(values: Integers) -> NDArray[np.uint8]:
    if ((values < 0) | (values > 255)).any():
        raise ValueError("a table's value is beyond a byte")
    return values.astype(np.uint8)


def _signed(values: Integers) -> NDArray[np.int8]:
    if (np.abs(values) > 127).any():
        raise ValueError("a table's value is beyond a byte")
    return values.astype(np.int8)
