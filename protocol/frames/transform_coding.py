"""The encoding of a frame transform: the profile data of the default profile's model packets.

A MessagePack map: `m` the modes, `t` the arrays, range-coded after the number of components; then,
if there are any, `l` the number of layer coefficients, and `s` the numbers of reserved modes that
are sent and that there are.
"""

from dataclasses import replace
from functools import lru_cache
from itertools import takewhile
from typing import Any, NamedTuple

import msgpack  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import BitCoder, RangeDecoder, RangeEncoder
from protocol.entropy.validation import check_int
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    MAX_LAYER_COEFFICIENTS,
    MAX_MODES,
    SCALE_CODE_STEP,
    FrameTransform,
    max_components,
    with_reserved_modes,
    without_reserved_modes,
)
from protocol.frames.temporal_prediction import PREDICTION_KINDS
from protocol.limits import MAX_IMAGE_BYTES, MAX_MESSAGE_LENGTH
from shared_model.arrays import Integers, Picture
from shared_model.parameters import EAUS

_KEYS = ("m", "t")
_LAYERS_KEY, _RESERVED_KEY = "l", "s"
# The tables of the model in use, of its update, and of those before.
KEPT_TABLES = 8
# Groups of columns of the basis: motion, EAUs, layer coefficients, mode coefficients.
_GROUPS = 4


def serialise_transform(transform: FrameTransform) -> bytes:
    """The model packet's profile data.  Empty reserved modes take no bytes."""
    base = without_reserved_modes(transform)
    tables = bytes([len(base.basis)]) + _coded_tables(_Tables.of(base), base.layers)
    sent = tuple(takewhile(bool, transform.modes[len(base.modes) :]))
    fields: dict[str, Any] = dict(zip(_KEYS, (base.modes + sent, tables), strict=True))
    if base.layers:
        fields[_LAYERS_KEY] = base.layers
    if transform.reserved_modes:
        fields[_RESERVED_KEY] = (len(sent), transform.reserved_modes)
    data: bytes = msgpack.packb(fields)
    return data


def parse_transform(data: bytes) -> FrameTransform:
    """The transform in a model packet's profile data.  Raises `ProtocolError` if it is damaged."""
    try:
        fields: Any = msgpack.unpackb(
            data,
            use_list=False,
            max_str_len=1,
            max_bin_len=MAX_IMAGE_BYTES,
            max_array_len=MAX_MODES,
            max_map_len=len(_KEYS) + 2,
            max_ext_len=0,
        )
        transform = _transform_from_fields(fields)
        if serialise_transform(transform) != data:
            raise ValueError("not in the one encoding of its fields")
        return transform
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"model packet's transform: {error}"[:MAX_MESSAGE_LENGTH]) from error


def _transform_from_fields(fields: Any) -> FrameTransform:
    if unknown := set(fields) - {*_KEYS, _LAYERS_KEY, _RESERVED_KEY}:
        raise ValueError(f"unknown fields {sorted(map(str, unknown))}")
    modes, tables = (fields[key] for key in _KEYS)
    layers = _layer_count(fields)
    if not isinstance(modes, tuple) or not all(isinstance(mode, bytes) for mode in modes):
        raise ValueError("modes are not byte strings")
    if not isinstance(tables, bytes) or not tables or not 1 <= tables[0] <= max_components(layers):
        raise ValueError("no tables")
    sent, reserved = _reserved_counts(fields, modes)
    known = modes[: len(modes) - sent]
    base = replace(_parsed_tables(tables, layers, len(known)), modes=known)
    extended = with_reserved_modes(base, reserved)
    return replace(extended, modes=modes + extended.modes[len(modes) :])


@lru_cache(maxsize=KEPT_TABLES)
def _parsed_tables(tables: bytes, layers: int, modes: int) -> FrameTransform:
    """The transform of `t`, with empty modes; it takes longer than a frame, and each layer of a
    model asks for it again.  Raises `ValueError` if it is damaged."""
    d, n = GEOMETRY_SIZE + layers + modes, tables[0]
    empty = FrameTransform(
        (b"",) * modes,
        unit_codes=np.zeros(d, np.uint8),
        mean_codes=np.zeros(d, np.int64),
        basis=np.zeros((n, d), np.int8),
        exponents=np.zeros(n, np.int8),
        scale_codes=np.zeros((n, PREDICTION_KINDS), np.uint8),
        layers=layers,
    )
    coder = RangeDecoder(tables[1:])
    parsed = _code_tables(coder, empty)
    if coder.unread_bytes:
        raise ValueError(f"{coder.unread_bytes} bytes too many")
    for array in _arrays_of(parsed):
        array.setflags(write=False)
    return parsed


class _Tables(NamedTuple):
    """The arrays of a transform, to be looked up: (bytes, type, shape) of each."""

    arrays: tuple[tuple[bytes, str, tuple[int, ...]], ...]

    @classmethod
    def of(cls, transform: FrameTransform) -> "_Tables":
        arrays = _arrays_of(transform)
        return cls(tuple((each.tobytes(), each.dtype.str, each.shape) for each in arrays))


def _arrays_of(transform: FrameTransform) -> tuple[NDArray[Any], ...]:
    return (
        transform.unit_codes,
        transform.mean_codes,
        transform.basis,
        transform.exponents,
        transform.scale_codes,
    )


@lru_cache(maxsize=KEPT_TABLES)
def _coded_tables(tables: _Tables, layers: int) -> bytes:
    """The bytes of tables; see `_parsed_tables`."""
    arrays: list[NDArray[Any]] = [
        np.frombuffer(data, kind).reshape(shape) for data, kind, shape in tables.arrays
    ]
    units, means, basis, exponents, scales = arrays
    modes = (b"",) * (len(units) - GEOMETRY_SIZE - layers)
    coder = RangeEncoder()
    transform = FrameTransform(modes, units, means, basis, exponents, scales, layers=layers)
    _code_tables(coder, transform)
    return coder.finish()


def _reserved_counts(fields: Any, modes: tuple[bytes, ...]) -> tuple[int, int]:
    """How many of the modes sent are reserved ones, and how many reserved ones there are."""
    sent, reserved = fields.get(_RESERVED_KEY, (0, 0))
    check_int("reserved modes", reserved, 0, MAX_MODES)
    check_int("reserved modes sent", sent, 0, min(reserved, len(modes)))
    return sent, reserved


def _layer_count(fields: Any) -> int:
    if _LAYERS_KEY not in fields:
        return 0
    count: int = fields[_LAYERS_KEY]
    check_int("layer coefficients", count, 1, MAX_LAYER_COEFFICIENTS)
    return count


def _code_tables(coder: BitCoder, transform: FrameTransform) -> FrameTransform:
    """Code all arrays; a decoder uses only their sizes.  Returns the transform coded."""
    sizes = [6, len(EAUS), transform.layers, len(transform.modes)]
    groups = np.repeat(range(_GROUPS), sizes)[None]
    unit_steps = np.diff(transform.unit_codes.astype(np.int64), prepend=0).astype(np.int64)
    # Second differences: from kind to kind, then from component to component.
    scales = transform.scale_codes.astype(np.int64) // SCALE_CODE_STEP
    scale_steps = np.diff(np.diff(scales, axis=1, prepend=0), axis=0, prepend=0).astype(np.int64)
    unit_steps = _code_table(coder, unit_steps[None], 1)[0]
    mean_codes = _code_table(coder, transform.mean_codes[None], 1)[0]
    basis = _code_table(coder, transform.basis.astype(np.int64), _GROUPS, groups)
    exponents = _code_table(coder, transform.exponents.astype(np.int64)[None], 1)[0]
    kinds = np.arange(PREDICTION_KINDS)[None]
    scale_steps = _code_table(coder, scale_steps, PREDICTION_KINDS, kinds)
    return FrameTransform(
        transform.modes,
        unit_codes=_as_uint8(np.cumsum(unit_steps)),
        mean_codes=mean_codes,
        basis=_as_int8(basis),
        exponents=_as_int8(exponents),
        scale_codes=_as_uint8(SCALE_CODE_STEP * scale_steps.cumsum(0).cumsum(1)),
        layers=transform.layers,
    )


def _code_table(
    coder: BitCoder, values: Integers, contexts: int, context: Integers | None = None
) -> Integers:
    """Code integers (r, c) row by row.  context: (1, c) of each column, 0..contexts - 1."""
    integers = AdaptiveIntegers(contexts)
    of_column = [0] * values.shape[1] if context is None else context[0].tolist()
    rows = [
        [integers.code(coder, c, v) for c, v in zip(of_column, row, strict=True)]
        for row in values.tolist()
    ]
    return np.array(rows, dtype=np.int64)


def _as_uint8(values: Integers) -> Picture:
    if ((values < 0) | (values > 255)).any():
        raise ValueError("a table's value is beyond a byte")
    return values.astype(np.uint8)


def _as_int8(values: Integers) -> NDArray[np.int8]:
    if (np.abs(values) > 127).any():
        raise ValueError("a table's value is beyond a byte")
    return values.astype(np.int8)
