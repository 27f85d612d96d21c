"""Wavelet coefficients: the transform inverts, both ends agree, bad bytes are refused."""

import random

import numpy as np
import pytest
from numpy.typing import NDArray

from protocol.messages import ProtocolError
from protocol.wavelet import LEVELS, SubbandCoder, inverse_transform, transform

Array = NDArray[np.float64]
SHAPES = [(1, 1), (1, 7), (2, 3), (5, 4), (16, 16), (33, 47), (40, 64)]


def drawing(shape: tuple[int, int], seed: int = 1) -> Array:
    """(h, w) smooth shapes with an edge and a little noise, about 0."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.asarray(60 * np.sin(5 * x + seed) + 50 * (y > 0.4) + rng.normal(size=shape) * 2)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_transform_inverts(shape: tuple[int, int]) -> None:
    plane = drawing(shape)
    coarse, details = transform(plane, LEVELS)
    assert len(details) == LEVELS
    assert coarse.size + sum(b.size for level in details for b in level) == plane.size
    assert np.allclose(inverse_transform(coarse, details), plane, atol=1e-9)


def test_energy_gathers_in_the_coarse_part() -> None:
    plane = drawing((64, 64))
    details = transform(plane, 3)[1]
    fine = sum(float((b**2).sum()) for b in details[-1])
    assert fine < 0.05 * float((plane**2).sum())


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("step", [0.5, 8.0])
def test_a_decoder_gets_what_the_encoder_says(shape: tuple[int, int], step: float) -> None:
    sender, receiver = SubbandCoder(), SubbandCoder()
    half = (-(-shape[0] // 2), -(-shape[1] // 2))
    for seed in range(3):
        planes = [drawing(shape, seed), drawing(half, seed + 9), drawing(half, seed + 5)]
        data, stated = sender.encode(planes, step)
        decoded = receiver.decode(data, [shape, half, half], step)
        assert all(np.array_equal(a, b) for a, b in zip(stated, decoded, strict=True))
        # A step rounds by less than a step; what that makes of a pixel adds up over subbands.
        errors = [np.abs(a - b).max() for a, b in zip(planes, decoded, strict=True)]
        assert max(errors) < 4 * step


def test_finer_steps_cost_more_and_err_less() -> None:
    plane, sizes, errors = drawing((64, 64)), [], []
    for step in (1.0, 4.0, 16.0, 64.0):
        data, (decoded,) = SubbandCoder().encode([plane], step)
        sizes.append(len(data))
        errors.append(float(((decoded - plane) ** 2).mean()))
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)
    assert sizes[-1] < 60


def test_pictures_before_teach_where_something_happens() -> None:
    rng = np.random.default_rng(2)
    busy = np.zeros((64, 64))
    busy[20:34, 10:50] = 1
    series, sizes = SubbandCoder(), []
    for _ in range(4):
        picture = busy * rng.normal(size=busy.shape) * 40
        sizes.append(
            (len(series.encode([picture], 8.0)[0]), len(SubbandCoder().encode([picture], 8.0)[0]))
        )
    assert all(after < alone for after, alone in sizes[1:])


def test_the_largest_coefficients_survive() -> None:
    plane = np.zeros((16, 16))
    plane[5, 6], plane[12, 3] = 3e4, -3e4
    data, (stated,) = SubbandCoder().encode([plane], 2.0)
    (decoded,) = SubbandCoder().decode(data, [(16, 16)], 2.0)
    assert np.array_equal(stated, decoded) and np.abs(decoded - plane).max() < 8


def test_pictures_of_one_series_have_one_size() -> None:
    coder = SubbandCoder()
    coder.encode([drawing((32, 32))], 4.0)
    with pytest.raises(ValueError, match="size"):
        coder.encode([drawing((40, 40))], 4.0)


def test_bytes_too_many_are_refused() -> None:
    data, _ = SubbandCoder().encode([drawing((32, 32))], 8.0)
    with pytest.raises(ProtocolError, match="too many"):
        SubbandCoder().decode(data + bytes(12), [(32, 32)], 8.0)


def test_every_truncation_and_bit_flip_is_a_picture_or_a_protocol_error() -> None:
    data, _ = SubbandCoder().encode([drawing((16, 12))], 12.0)
    flipped = [
        data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
        for place in range(len(data))
        for bit in range(8)
    ]
    for damaged in [data[:n] for n in range(len(data))] + flipped:
        check(damaged)


def test_fuzz_of_random_bytes() -> None:
    seed = 20261121
    rng = random.Random(seed)
    for _ in range(200):
        check(rng.randbytes(rng.randrange(200)))
    check(b"\xff" * 300)


def check(data: bytes) -> None:
    """A picture of finite values, or a protocol error, and nothing else."""
    try:
        (plane,) = SubbandCoder().decode(data, [(16, 12)], 12.0)
    except ProtocolError:
        return
    assert plane.shape == (16, 12) and np.isfinite(plane).all()
