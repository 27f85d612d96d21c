"""Planes of wavelet coefficients: both ends agree, what is known helps, bad bytes are refused."""

import random

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.choose import choose
from protocol.entropy import WHOLE
from protocol.foresee import LOGITS, Network, Site, networks
from protocol.messages import ProtocolError
from protocol.subbands import MODE, STILL, TEXTURE, Pyramid, Series, blank, read, restored
from protocol.surroundings import SIZE_FEATURES, SOURCES, Surroundings, Turn
from protocol.wavelet import LEVELS, transform

Array = NDArray[np.float64]
SHAPES = [(1, 1), (1, 7), (2, 3), (5, 4), (16, 16), (33, 47), (40, 64)]


def drawing(shape: tuple[int, int], seed: int = 1) -> Array:
    """(h, w) smooth shapes with an edge and a little noise, about 0."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.asarray(60 * np.sin(5 * x + seed) + 50 * (y > 0.4) + rng.normal(size=shape) * 2)


def half(shape: tuple[int, int]) -> tuple[int, int]:
    return -(-shape[0] // 2), -(-shape[1] // 2)


def encode(series: Series, planes: list[Array], step: float) -> tuple[bytes, list[Pyramid]]:
    """The bytes of planes as the next of a series, and the integers chosen."""
    choice = choose(series, [transform(plane / step, LEVELS) for plane in planes])
    data = choice.tape.write()
    assert len(data) - 2 <= choice.bits / 8 <= len(data) + 2
    return data, choice.pyramids


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
    shapes = [shape, half(shape), half(shape)]
    for seed in range(3):
        planes = [drawing(each, seed + 4 * i) for i, each in enumerate(shapes)]
        data, chosen = encode(sender, planes, step)
        found = read(receiver, data, shapes)
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
    found = read(Series(kind), data, [(16, 16)])
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
    assert same(read(receiver, data, [(32, 32)]), chosen)


def test_pictures_of_one_series_have_one_size() -> None:
    series = Series(MODE)
    encode(series, [drawing((32, 32))], 4.0)
    with pytest.raises(ValueError, match="size"):
        encode(series, [drawing((40, 40))], 4.0)


@pytest.mark.parametrize("size", range(5))
def test_every_coefficient_that_matters_little_is_left_out(size: int) -> None:
    """Of one lonely coefficient, a size of less than a step costs more than it spares."""
    empty = blank((64, 64))
    details = [[band.astype(np.float64) for band in level] for level in empty.details]
    details[-1][2][9, 12] = 0.2 * size
    choice = choose(Series(MODE), [(empty.coarse.astype(np.float64), details)])
    assert not any(band.any() for band in bands(choice.pyramids[0]))


def test_what_is_known_around_a_place_comes_from_all_its_sides() -> None:
    grid = (8, 8)
    sources = np.zeros((len(SOURCES), *grid), np.int64)
    around = Surroundings(sources, np.ones(grid, bool), np.zeros(grid, np.int64))
    turns = around.turns()
    first = next(turns)
    assert not around.around_sizes(first).any() and not around.around_signs(first).any()
    around.learn(first, np.where((first.rows == 4) & (first.columns == 2), -7, 0))
    diagonal = next(turns)
    near = np.abs(diagonal.rows - 4) + np.abs(diagonal.columns - 2) == 2
    beside = (np.abs(diagonal.rows - 4) == 1) & (np.abs(diagonal.columns - 2) == 1)
    signs = around.around_signs(diagonal)
    assert near[beside].all() and (signs[beside] < 0).sum() == 4
    # The other side of the face is seen as well.
    opposite = (np.abs(diagonal.rows - 4) <= 1) & (np.abs(diagonal.columns - 5) <= 1)
    assert (around.around_sizes(diagonal)[opposite] > 0).any()
    around.learn(diagonal, np.zeros(len(diagonal.rows), np.int64))
    assert [turn.number for turn in turns] == [2, 3]


def test_networks_are_integers_and_their_probabilities_leave_room() -> None:
    found = networks()
    assert networks() is found
    turn = Turn(0, (32, 32), np.arange(8), np.arange(8))
    for features in (np.zeros((8, SIZE_FEATURES)), np.full((8, SIZE_FEATURES), 160.0)):
        zeros = found.sizes.zeros(features, Site(MODE, 0, 3, 1, 5), turn)
        assert zeros.dtype == np.int64 and zeros.min() > 0 and zeros.max() < WHOLE


def test_probabilities_stay_within_their_bounds_whatever_the_weights_are() -> None:
    features, classes, _ = (np.ones((n, 2)) for n in (SIZE_FEATURES + 2, 64, 1))
    turn = Turn(1, (16, 16), np.arange(4), np.arange(4))
    for sign in (-1, 1):
        last = np.full((3, 1), sign * 2.0**40)
        network = Network(features, classes, last)
        zeros = network.zeros(np.full((4, SIZE_FEATURES), 100.0), Site(STILL, 0, 1, 0), turn)
        assert ((zeros > 0) & (zeros < WHOLE)).all()
    assert LOGITS > 0


def test_what_is_the_same_for_a_turn_is_forgotten_when_there_is_too_much_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("protocol.foresee.MOST_KNOWN", 2)
    network, turn = networks().tiles, Turn(0, (16, 16), np.arange(4), np.arange(4))
    features = np.zeros((4, SIZE_FEATURES))
    sites = [Site(MODE, 0, 2, 0, pictures) for pictures in range(4)]
    before = [network.zeros(features, site, turn) for site in sites]
    again = [network.zeros(features, site, turn) for site in sites]
    assert all(np.array_equal(a, b) for a, b in zip(before, again, strict=True))


def test_bytes_too_many_are_refused() -> None:
    data, _ = encode(Series(STILL), [drawing((32, 32))], 8.0)
    with pytest.raises(ProtocolError, match="too many"):
        read(Series(STILL), data + bytes(12), [(32, 32)])


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
    rng = random.Random(seed)
    for number in range(200):
        check(rng.randbytes(rng.randrange(200)), number % 3)
    for kind in (STILL, MODE):
        check(b"\xff" * 300, kind)


def check(data: bytes, kind: int) -> None:
    """A picture of finite values, or a protocol error, and nothing else."""
    try:
        (found,) = read(Series(kind), data, [(16, 12)])
    except ProtocolError:
        return
    plane = restored(found, 12.0)
    assert plane.shape == (16, 12) and np.isfinite(plane).all()
