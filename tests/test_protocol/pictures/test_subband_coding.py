"""Planes of wavelet coefficients: both ends agree, context saves bits, damage is refused."""

import random
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from pyramids import bands, same

from assets.array_context import CodingPass, CoefficientContext, log_feature, zero_probabilities
from encoder.picture_coding.picture_rdoq import quantise_picture
from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.errors import ProtocolError
from protocol.pictures.coefficient_coding import MAX_MAGNITUDE
from protocol.pictures.coefficient_context import (
    MAGNITUDE_FEATURES,
    ContextBand,
)
from protocol.pictures.picture_codec import plane_shapes
from protocol.pictures.plane_decoding import decode_planes
from protocol.pictures.probability_model import (
    BACKGROUND,
    CLASS_COUNT,
    LOGIT_BITS,
    MAX_HIDDEN,
    MAX_LOGIT,
    MIN_PROBABILITY,
    MODE,
    TEXTURE,
    WEIGHT_ARRAYS,
    BandPosition,
    Mlp,
    ProbabilityModels,
    probability_models,
)
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid, dequantised, empty_pyramid
from protocol.pictures.wavelet import LEVELS, transform
from shared_model.arrays import Array

VECTORS = Path(__file__).parents[2] / "vectors"
SHAPES = [(1, 1), (1, 7), (2, 3), (5, 4), (16, 16), (33, 47), (40, 64)]


def drawing(shape: tuple[int, int], seed: int = 1) -> Array:
    """(h, w) smooth shapes with an edge and a little noise, about 0."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.asarray(60 * np.sin(5 * x + seed) + 50 * (y > 0.4) + rng.normal(size=shape) * 2)


def encode(
    sequence: PictureSequence, planes: list[Array], step: float
) -> tuple[bytes, list[SubbandPyramid]]:
    """The bytes of planes as the next of a sequence, and the integers chosen."""
    pyramids, tape = quantise_picture(
        sequence, [transform(plane / step, LEVELS) for plane in planes]
    )
    data = tape.serialise()
    assert data == tape.serialise() and len(data) <= np.ceil((tape.bits + 1) / 8) <= len(data) + 2
    return data, pyramids


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", [BACKGROUND, TEXTURE, MODE])
@pytest.mark.parametrize("step", [0.5, 8.0])
def test_a_decoder_gets_what_the_encoder_chose(
    shape: tuple[int, int], kind: int, step: float
) -> None:
    sender, receiver = PictureSequence(kind), PictureSequence(kind)
    shapes = plane_shapes(*shape)
    for seed in range(3):
        planes = [drawing(each, seed + 4 * i) for i, each in enumerate(shapes)]
        data, chosen = encode(sender, planes, step)
        found = decode_planes(receiver, "it", data, shapes)
        assert same(found, chosen) and receiver.pictures == seed + 1
        # A step rounds by less than a step; what that makes of a pixel adds up over subbands.
        for plane, pyramid in zip(planes, found, strict=True):
            assert np.abs(dequantised(pyramid, step) - plane).max() < 4 * step


def test_finer_steps_cost_more_and_err_less() -> None:
    plane, sizes, errors = drawing((64, 64)), [], []
    for step in (1.0, 4.0, 16.0, 64.0):
        data, (chosen,) = encode(PictureSequence(BACKGROUND), [plane], step)
        sizes.append(len(data))
        errors.append(float(((dequantised(chosen, step) - plane) ** 2).mean()))
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)
    assert sizes[-1] < 60


@pytest.mark.parametrize("kind", [TEXTURE, MODE])
def test_previous_pictures_predict_the_positions_of_coefficients(kind: int) -> None:
    rng = np.random.default_rng(2)
    busy = np.zeros((64, 64))
    busy[20:34, 10:50] = 1
    sequence, sizes = PictureSequence(kind), []
    for _ in range(4):
        picture = busy * rng.normal(size=busy.shape) * 40
        alone = encode(PictureSequence(kind), [picture], 8.0)[0]
        sizes.append((len(encode(sequence, [picture], 8.0)[0]), len(alone)))
    assert sizes[0][0] == sizes[0][1]
    assert sum(after for after, _ in sizes[1:]) < 0.97 * sum(alone for _, alone in sizes[1:])


@pytest.mark.parametrize("kind", [BACKGROUND, MODE])
def test_the_largest_coefficients_survive(kind: int) -> None:
    plane = np.zeros((16, 16))
    plane[5, 6], plane[12, 3] = 3e4, -3e4
    data, chosen = encode(PictureSequence(kind), [plane], 2.0)
    found = decode_planes(PictureSequence(kind), "it", data, [(16, 16)])
    assert same(found, chosen) and np.abs(dequantised(found[0], 2.0) - plane).max() < 8


def test_a_copy_is_independent() -> None:
    first, second, third = (drawing((32, 32), seed) for seed in range(3))
    sequence = PictureSequence(MODE)
    encode(sequence, [first], 4.0)
    copy = sequence.copy()
    encode(copy, [second], 4.0)
    data, chosen = encode(sequence, [third], 4.0)
    receiver = PictureSequence(MODE)
    encode(receiver, [first], 4.0)
    assert same(decode_planes(receiver, "it", data, [(32, 32)]), chosen)


def test_pictures_of_one_sequence_have_one_size() -> None:
    sequence = PictureSequence(MODE)
    encode(sequence, [drawing((32, 32))], 4.0)
    with pytest.raises(ValueError, match="size"):
        encode(sequence, [drawing((40, 40))], 4.0)


@pytest.mark.parametrize(("lonely", "kept"), [(0.84, 0), (0.9, 0), (1.6, 1), (3.2, 3)])
def test_a_coefficient_that_costs_more_than_it_saves_is_left_out(lonely: float, kept: int) -> None:
    empty = empty_pyramid((64, 64))
    details = [[band.astype(np.float64) for band in level] for level in empty.details]
    details[-1][2][9, 12] = lonely
    (chosen,), _ = quantise_picture(
        PictureSequence(MODE), [(empty.lowpass.astype(np.float64), details)]
    )
    assert chosen.details[-1][2][9, 12] == kept
    assert sum(np.abs(band).sum() for band in bands(chosen)) == kept


def test_coefficients_beyond_the_largest_magnitude_are_clipped() -> None:
    plane = np.full((32, 32), 1e9)
    data, (chosen,) = encode(PictureSequence(MODE), [plane], 1.0)
    assert np.abs(chosen.lowpass).max() == MAX_MAGNITUDE
    assert same(decode_planes(PictureSequence(MODE), "it", data, [(32, 32)]), [chosen])


def test_context_comes_from_all_sides_of_a_position() -> None:
    grid = (8, 8)
    sources = np.zeros((len(ContextBand), *grid), np.int64)
    context = CoefficientContext(sources, np.ones(grid, bool), np.zeros(grid, np.int64))
    passes = context.passes()
    first = next(passes)
    assert not context.magnitude_features(first).any() and not context.sign_features(first).any()
    context.set_known(first, np.where((first.rows == 4) & (first.columns == 2), -7, 0))
    diagonal = next(passes)
    beside = (np.abs(diagonal.rows - 4) == 1) & (np.abs(diagonal.columns - 2) == 1)
    signs = context.sign_features(diagonal)
    assert beside.sum() == 4 and (signs[beside] < 0).sum() == 4
    # The other side of the face is seen as well.
    opposite = (np.abs(diagonal.rows - 4) <= 1) & (np.abs(diagonal.columns - 5) <= 1)
    assert (context.magnitude_features(diagonal)[opposite] > 0).any()
    context.set_known(diagonal, np.zeros(len(diagonal.rows), np.int64))
    assert [coding_pass.number for coding_pass in passes] == [2, 3]


def test_weights_are_integers_and_their_sums_are_exact() -> None:
    """Floating point counts integers up to 2 ** 53 exactly, in whatever order they are added."""
    with np.load(str(files("protocol") / "data/probability_model.npz")) as stored:
        assert set(stored) == {
            f"{name}_{part}" for name in ProbabilityModels.__slots__ for part in WEIGHT_ARRAYS
        }
        weights = {name: values.astype(object) for name, values in stored.items()}
        assert all(values.dtype.kind == "i" for values in stored.values())
    for name in ProbabilityModels.__slots__:
        features, classes, last = (np.abs(weights[f"{name}_{part}"]) for part in WEIGHT_ARRAYS)
        assert len(classes) == CLASS_COUNT
        first = features.sum(0) * int(log_feature(1 << 30)) + 7 * classes.max(0)
        assert max(first) < 2**53 and max((last * MAX_HIDDEN).sum(0)) < 2**53


def test_no_table_rounds_differently_on_another_machine() -> None:
    logarithms = 16 * np.log2(1 + np.arange(1024))
    logits = np.arange(-MAX_LOGIT, MAX_LOGIT + 1) / 2**LOGIT_BITS
    for exact in (logarithms, PROBABILITY_ONE / (1 + np.exp(-logits))):
        assert np.abs(exact - np.floor(exact) - 0.5).min() > 3e-4


@pytest.mark.parametrize("sign", [-1, 1])
def test_probabilities_are_bounded_for_all_weights(sign: int) -> None:
    features, classes = np.full((MAGNITUDE_FEATURES + 2, 2), 2.0**15), np.ones((CLASS_COUNT, 2))
    network = Mlp(features, classes, np.full((3, 1), sign * 2.0**31))
    coding_pass = CodingPass(1, (16, 16), np.arange(4), np.arange(4))
    zeros = zero_probabilities(
        network,
        np.full((4, MAGNITUDE_FEATURES), 100.0),
        BandPosition(BACKGROUND, 0, 1, 0),
        coding_pass,
    )
    assert (zeros == (MIN_PROBABILITY if sign < 0 else PROBABILITY_ONE - MIN_PROBABILITY)).all()
    assert probability_models() is probability_models()


@pytest.mark.parametrize("kind", [BACKGROUND, TEXTURE, MODE])
def test_golden_bytes_decode_as_before(kind: int) -> None:
    """Other weights, tables or another order would make stored calls unreadable."""
    lines = (VECTORS / f"picture_{('background', 'texture', 'mode')[kind]}.txt").read_text().split()
    sequence = PictureSequence(kind)
    for data, *expected in zip(*[iter(lines)] * 4, strict=True):
        found = decode_planes(sequence, "it", bytes.fromhex(data), plane_shapes(24, 20))
        assert [text_of(pyramid) for pyramid in found] == expected


def text_of(pyramid: SubbandPyramid) -> str:
    return ",".join(str(value) for band in bands(pyramid) for value in band.ravel())


def test_bytes_too_many_are_refused() -> None:
    data, chosen = encode(PictureSequence(BACKGROUND), [drawing((32, 32))], 8.0)
    sequence = PictureSequence(BACKGROUND)
    with pytest.raises(ProtocolError, match=r"it: \d+ bytes too many"):
        decode_planes(sequence, "it", data + bytes(12), [(32, 32)])
    # What was refused has taught nothing.
    assert sequence.pictures == 0 and same(decode_planes(sequence, "it", data, [(32, 32)]), chosen)


def test_a_coefficient_beyond_all_limits_is_refused() -> None:
    with pytest.raises(ProtocolError, match="it: a value is too large"):
        decode_planes(PictureSequence(BACKGROUND), "it", b"\xff" * 99, [(16, 16)])


@pytest.mark.no_cover
@pytest.mark.parametrize("kind", [BACKGROUND, MODE])
def test_every_truncation_and_bit_flip_is_a_picture_or_a_protocol_error(kind: int) -> None:
    data, _ = encode(PictureSequence(kind), [drawing((16, 12))], 12.0)
    flipped = [
        data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
        for place in range(len(data))
        for bit in range(8)
    ]
    for damaged in [data[:n] for n in range(len(data))] + flipped:
        check(damaged, kind)


@pytest.mark.no_cover
def test_fuzz_of_random_bytes() -> None:
    seed = 20261121
    print("seed", seed)
    rng = random.Random(seed)
    for number in range(200):
        check(rng.randbytes(rng.randrange(200)), number % 3)
    for kind in (BACKGROUND, MODE):
        check(b"\xff" * 300, kind)


@pytest.mark.no_cover
def test_fuzz_of_a_sequence_of_colour_pictures() -> None:
    seed = 20261122
    print("seed", seed)
    rng = random.Random(seed)
    shapes = plane_shapes(20, 24)
    for _ in range(60):
        sequence = PictureSequence(MODE)
        for _ in range(3):
            try:
                decode_planes(sequence, "it", rng.randbytes(rng.randrange(120)), shapes)
            except ProtocolError:
                continue
    sender = PictureSequence(MODE)
    planes = [drawing(shape) for shape in shapes]
    packets = [encode(sender, [i * plane for plane in planes], 6.0)[0] for i in (1, 2, 3)]
    for _ in range(60):
        sequence = PictureSequence(MODE)
        for data in packets:
            damaged = bytearray(data)
            damaged[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            try:
                found = decode_planes(sequence, "it", bytes(damaged), shapes)
            except ProtocolError:
                continue
            assert all(np.isfinite(dequantised(plane, 6.0)).all() for plane in found)


def check(data: bytes, kind: int) -> None:
    """A picture of finite values, or a protocol error, and nothing else."""
    try:
        (found,) = decode_planes(PictureSequence(kind), "it", data, [(16, 12)])
    except ProtocolError:
        return
    plane = dequantised(found, 12.0)
    assert plane.shape == (16, 12) and np.isfinite(plane).all()
