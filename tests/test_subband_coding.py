"""Planes of wavelet coefficients: both ends agree, what is known helps, bad bytes are refused."""

import random
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.picture_coding.picture_rdoq import choose
from protocol.entropy.range_coder import WHOLE
from protocol.packets import ProtocolError
from protocol.pictures.coefficient_coding import MAX_SIZE
from protocol.pictures.coefficient_context import (
    SIZE_FEATURES,
    Source,
    Surroundings,
    Turn,
    logarithm,
)
from protocol.pictures.picture_codec import plane_shapes
from protocol.pictures.probability_model import (
    CLASSES,
    LEAST,
    LOGIT_BITS,
    LOGITS,
    MODE,
    MOST_HIDDEN,
    PARTS,
    STILL,
    TEXTURE,
    Network,
    Networks,
    Site,
    networks,
)
from protocol.pictures.subband_coding import Pyramid, Series, blank, read, restored
from protocol.pictures.wavelet import LEVELS, transform

Array = NDArray[np.float64]
VECTORS = Path(__file__).parent / "vectors"
SHAPES = [(1, 1), (1, 7), (2, 3), (5, 4), (16, 16), (33, 47), (40, 64)]


def drawing(shape: tuple[int, int], seed: int = 1) -> Array:
    """(h, w) smooth shapes with an edge and a little noise, about 0."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.asarray(60 * np.sin(5 * x + seed) + 50 * (y > 0.4) + rng.normal(size=shape) * 2)


def encode(series: Series, planes: list[Array], step: float) -> tuple[bytes, list[Pyramid]]:
    """The bytes of planes as the next of a series, and the integers chosen."""
    pyramids, tape = choose(series, [transform(plane / step, LEVELS) for plane in planes])
    data = tape.write()
    assert data == tape.write() and len(data) <= np.ceil((tape.bits + 1) / 8) <= len(data) + 2
    return data, pyramids


def same(ours: list[Pyramid], theirs: list[Pyramid]) -> bool:
    pairs = zip(ours, theirs, strict=True)
    return all(
        np.array_equal(a, b)
        for one, other in pairs
        for a, b in zip(bands(one), bands(other), strict=True)
    )


def bands(pyramid: Pyramid) -> list[NDArray[np.int64]]:
    return [pyramid.coarse, *(band for level in pyramid.details for band in level)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", [STILL, TEXTURE, MODE])
@pytest.mark.parametrize("step", [0.5, 8.0])
def test_a_decoder_gets_what_the_encoder_chose(
    shape: tuple[int, int], kind: int, step: float
) -> None:
    sender, receiver = Series(kind), Series(kind)
    shapes = plane_shapes(*shape)
    for seed in range(3):
        planes = [drawing(each, seed + 4 * i) for i, each in enumerate(shapes)]
        data, chosen = encode(sender, planes, step)
        found = read(receiver, "it", data, shapes)
        assert same(found, chosen) and receiver.pictures == seed + 1
        # A step rounds by less than a step; what that makes of a pixel adds up over subbands.
        for plane, pyramid in zip(planes, found, strict=True):
            assert np.abs(restored(pyramid, step) - plane).max() < 4 * step


def test_finer_steps_cost_more_and_err_less() -> None:
    plane, sizes, errors = drawing((64, 64)), [], []
    for step in (1.0, 4.0, 16.0, 64.0):
        data, (chosen,) = encode(Series(STILL), [plane], step)
        sizes.append(len(data))
        errors.append(float(((restored(chosen, step) - plane) ** 2).mean()))
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)
    assert sizes[-1] < 60


@pytest.mark.parametrize("kind", [TEXTURE, MODE])
def test_pictures_before_teach_where_something_happens(kind: int) -> None:
    rng = np.random.default_rng(2)
    busy = np.zeros((64, 64))
    busy[20:34, 10:50] = 1
    series, sizes = Series(kind), []
    for _ in range(4):
        picture = busy * rng.normal(size=busy.shape) * 40
        alone = encode(Series(kind), [picture], 8.0)[0]
        sizes.append((len(encode(series, [picture], 8.0)[0]), len(alone)))
    assert sizes[0][0] == sizes[0][1]
    assert sum(after for after, _ in sizes[1:]) < 0.97 * sum(alone for _, alone in sizes[1:])


@pytest.mark.parametrize("kind", [STILL, MODE])
def test_the_largest_coefficients_survive(kind: int) -> None:
    plane = np.zeros((16, 16))
    plane[5, 6], plane[12, 3] = 3e4, -3e4
    data, chosen = encode(Series(kind), [plane], 2.0)
    found = read(Series(kind), "it", data, [(16, 16)])
    assert same(found, chosen) and np.abs(restored(found[0], 2.0) - plane).max() < 8


def test_a_copy_goes_on_by_itself() -> None:
    first, second, third = (drawing((32, 32), seed) for seed in range(3))
    series = Series(MODE)
    encode(series, [first], 4.0)
    copy = series.copy()
    encode(copy, [second], 4.0)
    data, chosen = encode(series, [third], 4.0)
    receiver = Series(MODE)
    encode(receiver, [first], 4.0)
    assert same(read(receiver, "it", data, [(32, 32)]), chosen)


def test_pictures_of_one_series_have_one_size() -> None:
    series = Series(MODE)
    encode(series, [drawing((32, 32))], 4.0)
    with pytest.raises(ValueError, match="size"):
        encode(series, [drawing((40, 40))], 4.0)


@pytest.mark.parametrize(("lonely", "kept"), [(0.84, 0), (0.9, 0), (1.6, 1), (3.2, 3)])
def test_a_coefficient_that_costs_more_than_it_spares_is_left_out(lonely: float, kept: int) -> None:
    empty = blank((64, 64))
    details = [[band.astype(np.float64) for band in level] for level in empty.details]
    details[-1][2][9, 12] = lonely
    (chosen,), _ = choose(Series(MODE), [(empty.coarse.astype(np.float64), details)])
    assert chosen.details[-1][2][9, 12] == kept
    assert sum(np.abs(band).sum() for band in bands(chosen)) == kept


def test_a_mode_whose_coefficients_are_beyond_all_sizes_is_cut() -> None:
    plane = np.full((32, 32), 1e9)
    data, (chosen,) = encode(Series(MODE), [plane], 1.0)
    assert np.abs(chosen.coarse).max() == MAX_SIZE
    assert same(read(Series(MODE), "it", data, [(32, 32)]), [chosen])


def test_what_is_known_around_a_place_comes_from_all_its_sides() -> None:
    grid = (8, 8)
    sources = np.zeros((len(Source), *grid), np.int64)
    around = Surroundings(sources, np.ones(grid, bool), np.zeros(grid, np.int64))
    turns = around.turns()
    first = next(turns)
    assert not around.around_sizes(first).any() and not around.around_signs(first).any()
    around.learn(first, np.where((first.rows == 4) & (first.columns == 2), -7, 0))
    diagonal = next(turns)
    beside = (np.abs(diagonal.rows - 4) == 1) & (np.abs(diagonal.columns - 2) == 1)
    signs = around.around_signs(diagonal)
    assert beside.sum() == 4 and (signs[beside] < 0).sum() == 4
    # The other side of the face is seen as well.
    opposite = (np.abs(diagonal.rows - 4) <= 1) & (np.abs(diagonal.columns - 5) <= 1)
    assert (around.around_sizes(diagonal)[opposite] > 0).any()
    around.learn(diagonal, np.zeros(len(diagonal.rows), np.int64))
    assert [turn.number for turn in turns] == [2, 3]


def test_networks_are_integers_and_their_sums_stay_exact() -> None:
    """Floating point counts integers up to 2 ** 53 exactly, in whatever order they are added."""
    with np.load(str(files("protocol") / "data/foresight.npz")) as stored:
        assert set(stored) == {f"{name}_{part}" for name in Networks.__slots__ for part in PARTS}
        weights = {name: values.astype(object) for name, values in stored.items()}
        assert all(values.dtype.kind == "i" for values in stored.values())
    for name in Networks.__slots__:
        features, classes, last = (np.abs(weights[f"{name}_{part}"]) for part in PARTS)
        assert len(classes) == CLASSES
        first = features.sum(0) * int(logarithm(1 << 30)) + 7 * classes.max(0)
        assert max(first) < 2**53 and max((last * MOST_HIDDEN).sum(0)) < 2**53


def test_no_table_rounds_differently_on_another_machine() -> None:
    logarithms = 16 * np.log2(1 + np.arange(1024))
    logits = np.arange(-LOGITS, LOGITS + 1) / 2**LOGIT_BITS
    for exact in (logarithms, WHOLE / (1 + np.exp(-logits))):
        assert np.abs(exact - np.floor(exact) - 0.5).min() > 3e-4


@pytest.mark.parametrize("sign", [-1, 1])
def test_probabilities_leave_room_whatever_the_weights_are(sign: int) -> None:
    features, classes = np.full((SIZE_FEATURES + 2, 2), 2.0**15), np.ones((CLASSES, 2))
    network = Network(features, classes, np.full((3, 1), sign * 2.0**31))
    turn = Turn(1, (16, 16), np.arange(4), np.arange(4))
    zeros = network.zeros(np.full((4, SIZE_FEATURES), 100.0), Site(STILL, 0, 1, 0), turn)
    assert (zeros == (LEAST if sign < 0 else WHOLE - LEAST)).all()
    assert networks() is networks()


@pytest.mark.parametrize("kind", [STILL, TEXTURE, MODE])
def test_golden_bytes_still_mean_what_they_did(kind: int) -> None:
    """Other weights, tables or another order would make stored calls unreadable."""
    lines = (VECTORS / f"picture_{('still', 'texture', 'mode')[kind]}.txt").read_text().split()
    series = Series(kind)
    for data, *expected in zip(*[iter(lines)] * 4, strict=True):
        found = read(series, "it", bytes.fromhex(data), plane_shapes(24, 20))
        assert [text_of(pyramid) for pyramid in found] == expected


def text_of(pyramid: Pyramid) -> str:
    return ",".join(str(value) for band in bands(pyramid) for value in band.ravel())


def test_bytes_too_many_are_refused() -> None:
    data, chosen = encode(Series(STILL), [drawing((32, 32))], 8.0)
    series = Series(STILL)
    with pytest.raises(ProtocolError, match=r"it: \d+ bytes too many"):
        read(series, "it", data + bytes(12), [(32, 32)])
    # What was refused has taught nothing.
    assert series.pictures == 0 and same(read(series, "it", data, [(32, 32)]), chosen)


@pytest.mark.parametrize("kind", [STILL, MODE])
def test_every_truncation_and_bit_flip_is_a_picture_or_a_protocol_error(kind: int) -> None:
    data, _ = encode(Series(kind), [drawing((16, 12))], 12.0)
    flipped = [
        data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
        for place in range(len(data))
        for bit in range(8)
    ]
    for damaged in [data[:n] for n in range(len(data))] + flipped:
        check(damaged, kind)


def test_fuzz_of_random_bytes() -> None:
    seed = 20261121
    print("seed", seed)
    rng = random.Random(seed)
    for number in range(200):
        check(rng.randbytes(rng.randrange(200)), number % 3)
    for kind in (STILL, MODE):
        check(b"\xff" * 300, kind)


def test_fuzz_of_a_series_of_colour_pictures() -> None:
    seed = 20261122
    print("seed", seed)
    rng = random.Random(seed)
    shapes = plane_shapes(20, 24)
    for _ in range(60):
        series = Series(MODE)
        for _ in range(3):
            try:
                read(series, "it", rng.randbytes(rng.randrange(120)), shapes)
            except ProtocolError:
                continue
    sender = Series(MODE)
    planes = [drawing(shape) for shape in shapes]
    packets = [encode(sender, [i * plane for plane in planes], 6.0)[0] for i in (1, 2, 3)]
    for _ in range(60):
        series = Series(MODE)
        for data in packets:
            damaged = bytearray(data)
            damaged[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            try:
                found = read(series, "it", bytes(damaged), shapes)
            except ProtocolError:
                continue
            assert all(np.isfinite(restored(plane, 6.0)).all() for plane in found)


def check(data: bytes, kind: int) -> None:
    """A picture of finite values, or a protocol error, and nothing else."""
    try:
        (found,) = read(Series(kind), "it", data, [(16, 12)])
    except ProtocolError:
        return
    plane = restored(found, 12.0)
    assert plane.shape == (16, 12) and np.isfinite(plane).all()
