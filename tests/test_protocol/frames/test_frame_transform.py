"""The frame transform: exact on the wire, bounded, and a valid face for any integers."""

import random
from dataclasses import replace

import msgpack  # type: ignore[import-untyped]
import numpy as np
import pytest

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeEncoder
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    MAX_BASIS_CODE,
    MAX_MEAN_CODE,
    MAX_MODES,
    RESERVED_SCALE_CODES,
    RESERVED_UNIT_CODE,
    FrameTransform,
    codes_from_units,
    face_from_coefficients,
    units_from_codes,
    vector_from_face,
    with_reserved_modes,
    without_reserved_modes,
)
from protocol.frames.temporal_prediction import (
    MAX_SCALE_CODE,
    MAX_VALUE,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
)
from protocol.frames.transform_coding import parse_transform, serialise_transform
from shared_model.geometry import pose_from_euler
from shared_model.parameters import EAU_HIGH, EAU_LOW, FaceParameters

REFERENCE = pose_from_euler(4.0, -12.0, 3.0, np.array([30.0, -20.0, 650.0]))
MODES = 2
D = GEOMETRY_SIZE + MODES


def sample(components: int = 5) -> FrameTransform:
    rng = np.random.default_rng(2)
    return FrameTransform(
        modes=(b"first mode", b"second"),
        unit_codes=rng.integers(120, 137, D, dtype=np.uint8),
        mean_codes=rng.integers(-3, 4, D),
        basis=rng.integers(-MAX_BASIS_CODE, MAX_BASIS_CODE + 1, (components, D), dtype=np.int8),
        exponents=rng.integers(-8, 0, components, dtype=np.int8),
        scale_codes=2
        * rng.integers(0, MAX_SCALE_CODE // 2 + 1, (components, PREDICTION_KINDS), dtype=np.uint8),
    )


def with_sent_reserved_modes(
    reserved: int, modes: tuple[bytes, ...], components: int = 5
) -> FrameTransform:
    """The sample with `reserved` reserved modes, the first of which have been sent."""
    extended = with_reserved_modes(sample(components), reserved)
    return replace(extended, modes=sample().modes + modes + (b"",) * (reserved - len(modes)))


def same(a: FrameTransform, b: FrameTransform) -> bool:
    return serialise_transform(a) == serialise_transform(b)


@pytest.mark.parametrize("count", [1, 5, 40])
def test_a_transform_survives_the_wire(count: int) -> None:
    components = sample(count)
    parsed = parse_transform(serialise_transform(components))
    assert same(parsed, components)
    assert np.array_equal(parsed.matrix, components.matrix)
    assert np.array_equal(parsed.scale_codes, components.scale_codes)


@pytest.mark.parametrize("modes", [(), (b"third",), (b"third", b"fourth", b"fifth")])
def test_reserved_modes_survive_the_wire(modes: tuple[bytes, ...]) -> None:
    components = with_sent_reserved_modes(3, modes)
    parsed = parse_transform(serialise_transform(components))
    assert (parsed.modes, parsed.reserved_modes) == (components.modes, 3)
    assert np.array_equal(parsed.matrix, components.matrix)
    assert np.array_equal(parsed.mean, components.mean)
    assert np.array_equal(parsed.scale_codes, components.scale_codes)


def test_empty_reserved_modes_take_no_bytes() -> None:
    few, many = (
        len(serialise_transform(with_reserved_modes(sample(), count))) for count in (1, 40)
    )
    assert few == many <= len(serialise_transform(sample())) + 5


def test_removing_reserved_modes_restores_the_transform() -> None:
    components = with_sent_reserved_modes(3, (b"third", b"fourth"))
    assert same(without_reserved_modes(components), sample())
    kept = without_reserved_modes(components, 2)
    assert (kept.modes, kept.reserved_modes) == (components.modes[:-1], 0)
    assert np.array_equal(kept.matrix, components.matrix[:-1, :-1])
    assert kept.scale_codes[-2:].tolist() == [list(RESERVED_SCALE_CODES)] * 2


def test_the_component_of_a_reserved_mode_moves_it_alone() -> None:
    coded = np.zeros(5 + 3, np.int64)
    before = face_from_coefficients(with_sent_reserved_modes(3, ()), coded, REFERENCE)
    coded[6] = 2 * STEPS_PER_UNIT
    after = face_from_coefficients(with_sent_reserved_modes(3, ()), coded, REFERENCE)
    change = vector_from_face(after, REFERENCE) - vector_from_face(before, REFERENCE)
    expected = np.zeros(D + 3)
    expected[D + 1] = 2 * units_from_codes(np.array([RESERVED_UNIT_CODE]))[0]
    assert change == pytest.approx(expected)


def test_unit_codes_are_those_of_their_units() -> None:
    codes = np.arange(256, dtype=np.uint8)
    assert np.array_equal(codes_from_units(units_from_codes(codes)), codes)
    assert codes_from_units(np.array([1e-9, 1.0, 1e9])).tolist() == [0, 128, 255]


def test_a_face_is_the_centre_and_its_components() -> None:
    components = sample()
    coded = np.array([3, -2, 0, 1, -1]) * STEPS_PER_UNIT
    expected = components.mean + (coded / STEPS_PER_UNIT) @ components.matrix
    face = face_from_coefficients(components, coded, REFERENCE)
    inside = np.clip(expected[6:GEOMETRY_SIZE], EAU_LOW, EAU_HIGH)
    vector = vector_from_face(face, REFERENCE)
    assert vector[:6] == pytest.approx(expected[:6], abs=1e-6)
    assert vector[6:GEOMETRY_SIZE] == pytest.approx(inside)
    assert vector[GEOMETRY_SIZE:] == pytest.approx(expected[GEOMETRY_SIZE:])


@pytest.mark.parametrize("value", [MAX_VALUE, -MAX_VALUE])
def test_the_largest_values_still_make_a_face(value: int) -> None:
    components = replace(sample(), exponents=np.full(5, 20, np.int8))
    face = face_from_coefficients(components, np.full(5, value), REFERENCE)
    assert is_finite(face)
    assert (face.eau >= EAU_LOW).all() and (face.eau <= EAU_HIGH).all()


def is_finite(face: FaceParameters) -> bool:
    arrays = (face.pose.rotation, face.pose.translation_mm, face.eau, face.modes)
    return all(bool(np.isfinite(array).all()) for array in arrays)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mean_codes": np.full(D, MAX_MEAN_CODE + 1)}, "mean beyond"),
        ({"basis": np.full((5, D), -128, np.int8)}, "basis beyond"),
        ({"unit_codes": np.ones(D - 1, np.uint8)}, "shapes"),
        ({"exponents": np.full(5, 21, np.int8)}, "exponent"),
        ({"exponents": np.zeros(4, np.int8)}, "shapes"),
        (
            {"scale_codes": np.full((5, PREDICTION_KINDS), MAX_SCALE_CODE + 1, np.uint8)},
            "scale codes",
        ),
        ({"scale_codes": np.zeros((5, PREDICTION_KINDS - 1), np.uint8)}, "scale codes"),
        ({"scale_codes": np.full((5, PREDICTION_KINDS), 7, np.uint8)}, "no multiples"),
        ({"basis": np.zeros((0, D), np.int8)}, "0 components"),
        ({"modes": (b"",) * (MAX_MODES + 1)}, "modes"),
        ({"reserved_modes": -1}, "-1 reserved modes"),
        ({"reserved_modes": MODES + 1}, "3 reserved modes of 2"),
        ({"reserved_modes": 1, "basis": np.zeros((1, D), np.int8)}, "1 components"),
    ],
)
def test_components_out_of_bounds_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(sample(), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "data", [b"", b"\xc0", b"\x90", b"\x80", msgpack.packb({"m": 1}), msgpack.packb([1, 2])]
)
def test_a_damaged_map_of_fields_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_transform(data)


def profile_data(unit_step: int = 0, basis: int = 0, trailing: bytes = b"") -> bytes:
    """A transform of one component without modes, whose tables begin with these values."""
    coder = RangeEncoder()
    for first, count in ((unit_step, GEOMETRY_SIZE), (0, GEOMETRY_SIZE)):
        integers = AdaptiveIntegers(1)
        for value in (first, *(0,) * (count - 1)):
            integers.code(coder, 0, value)
    integers = AdaptiveIntegers(3)
    for column in range(GEOMETRY_SIZE):
        integers.code(coder, 0 if column < 6 else 1, basis if not column else 0)
    AdaptiveIntegers(1).code(coder, 0, 0)
    scales = AdaptiveIntegers(PREDICTION_KINDS)
    for kind in range(PREDICTION_KINDS):
        scales.code(coder, kind, 0)
    data: bytes = msgpack.packb({"m": [], "t": b"\1" + coder.finish() + trailing})
    return data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (profile_data(unit_step=-1), "beyond a byte"),
        (profile_data(unit_step=256), "beyond a byte"),
        (profile_data(basis=-128), "beyond a byte"),
        (profile_data(trailing=bytes(10)), "bytes too many"),
        (msgpack.packb({"m": [], "t": b""}), "no tables"),
        (msgpack.packb({"m": [], "t": b"\x55"}), "no tables"),
        (msgpack.packb({"m": [], "t": "t"}), "no tables"),
    ],
)
def test_damaged_tables_are_refused_with_the_reason(data: bytes, message: str) -> None:
    assert not parse_transform(profile_data()).basis.any()
    with pytest.raises(ProtocolError, match=message):
        parse_transform(data)


def test_another_encoding_of_the_same_fields_is_refused() -> None:
    data = serialise_transform(with_reserved_modes(sample(), 2))
    fields = msgpack.unpackb(data, use_list=False)
    assert msgpack.packb(fields) == data
    for other in (dict(reversed(fields.items())), fields | {"l": 0}, fields | {"s": (0.0, 2)}):
        with pytest.raises(ProtocolError):
            parse_transform(msgpack.packb(other))
    longer = data.replace(msgpack.packb(b"second"), b"\xc5\x00\x06second")
    assert msgpack.unpackb(longer, use_list=False) == fields
    with pytest.raises(ProtocolError, match="not in the one encoding"):
        parse_transform(longer)


@pytest.mark.parametrize("modes", [b"x", (1, 2), ["x"]])
def test_modes_must_be_byte_strings(modes: object) -> None:
    fields = msgpack.unpackb(serialise_transform(sample()), use_list=False)
    with pytest.raises(ProtocolError):
        parse_transform(msgpack.packb(fields | {"m": modes}))


@pytest.mark.parametrize(
    "counts",
    [
        *((-1, 3), (0, -1), (0, MAX_MODES + 1), (2, 1), (MODES + 1, MODES + 1)),
        *((0, MAX_MODES - MODES + 1), (0.0, 2), (0, 2.0), (False, 2), (0, None)),
        *((), (0,), (0, 1, 2), 5, None),
    ],
)
def test_impossible_counts_of_reserved_modes_are_refused(counts: object) -> None:
    fields = msgpack.unpackb(serialise_transform(sample()), use_list=False)
    with pytest.raises(ProtocolError):
        parse_transform(msgpack.packb(fields | {"s": counts}))


@pytest.mark.no_cover
@pytest.mark.parametrize("components", [sample(2), with_sent_reserved_modes(3, (b"third",), 2)])
def test_every_truncation_and_bit_flip_is_components_or_a_protocol_error(
    components: FrameTransform,
) -> None:
    data = serialise_transform(components)
    for length in range(len(data)):
        with pytest.raises(ProtocolError):
            parse_transform(data[:length])
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        makes_a_face_or_a_protocol_error(bytes(flipped))


@pytest.mark.no_cover
def test_fuzz_of_mutated_components() -> None:
    seed = 511
    print(f"seed {seed}")
    rng = random.Random(seed)
    bases = [
        serialise_transform(base)
        for base in (sample(3), with_sent_reserved_modes(2, (b"third",), 3))
    ]
    for _ in range(1500):
        data = bytearray(rng.choice(bases))
        for _ in range(rng.randint(1, 3)):
            place = rng.randrange(len(data))
            data[place : place + rng.randint(0, 2)] = rng.randbytes(rng.randint(0, 2))
            data = data or bytearray(1)
        makes_a_face_or_a_protocol_error(bytes(data))


def makes_a_face_or_a_protocol_error(data: bytes) -> None:
    try:
        components = parse_transform(data)
    except ProtocolError:
        return
    coded = np.full(len(components.basis), 100 * STEPS_PER_UNIT)
    assert is_finite(face_from_coefficients(components, coded, REFERENCE))
