"""Photometric normalisation: invariance to the illumination."""

import numpy as np
import pytest
from shots import Shots

from encoder.appearance.photometric import NORMALISATIONS, equalise_histogram, retinex
from encoder.capture.colour import luma_f32

RANDOM = np.random.default_rng(6)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def test_all_levels_are_equally_frequent_after_equalisation() -> None:
    skewed = RANDOM.gamma(2, 10, (80, 90)).astype(np.float32)
    flat = equalise_histogram(skewed)
    share, _ = np.histogram(flat, 8, (0, 255))
    assert share == pytest.approx(np.full(8, flat.size / 8), rel=0.1)


def test_equalisation_keeps_the_order_of_levels() -> None:
    values = RANDOM.normal(size=(40, 50)).astype(np.float32)
    order = np.argsort(values, axis=None)
    assert (np.diff(equalise_histogram(values).ravel()[order]) >= 0).all()


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_uniform_picture_stays_finite(level: int) -> None:
    shown = retinex(np.full((30, 20, 3), level, np.uint8))
    assert shown.shape == (30, 20) and np.isfinite(shown).all()


def test_retinex_is_nearly_invariant_to_light_from_the_side(shots: Shots) -> None:
    picture = shots.pictures[0][60:180, 100:220]  # skin: what is even has no order to keep
    across = np.linspace(0.3, 1.0, picture.shape[1])[:, None]
    shadowed = np.asarray(np.rint(picture * across), np.uint8)
    before, after = retinex(picture), retinex(shadowed)
    assert correlation(before, after) > 0.95
    assert correlation(before, after) > correlation(luma_f32(picture), luma_f32(shadowed)) + 0.02


def test_without_normalisation_the_luma_is_compared(shots: Shots) -> None:
    picture = shots.pictures[0]
    assert np.array_equal(NORMALISATIONS["none"](picture), luma_f32(picture))
