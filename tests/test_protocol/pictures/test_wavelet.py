"""Wavelets: the transform inverts and gathers energy."""

import numpy as np
import pytest

from protocol.pictures.wavelet import LEVELS, inverse_transform, transform
from shared_model.arrays import Array

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
