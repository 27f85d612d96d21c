"""Means of pictures in which outliers count less."""

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.cauchy_weight import HALF_WEIGHT_GREY, cauchy_weight
from runtime.robust_mean import MEAN_PASSES, robust_mean
from shared_model.arrays import Single


def test_outliers_count_little() -> None:
    pictures = np.full((9, 2, 2, 3), 100, np.uint8)
    pictures[4] = 250
    mean = robust_mean(pictures, np.ones((9, 2, 2), np.float32))
    assert np.abs(mean - 100).max() < 2
    weights = np.ones((9, 2, 2), np.float32)
    weights[:4] = weights[5:] = 0
    assert np.abs(robust_mean(pictures, weights) - 250).max() < 1e-3


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_the_compiled_mean_is_that_of_numpy_for_any_number_of_threads(kind: type) -> None:
    random = np.random.default_rng(4)
    pictures: NDArray[np.generic] = random.uniform(0, 255, (7, 5, 6, 3)).astype(kind)
    weights = random.uniform(0, 1, (7, 5, 6)).astype(np.float32)
    weights[:, 0] = 0
    for workers in (1, 2, 8, None):
        found = robust_mean(pictures, weights, workers)
        assert np.array_equal(found, by_numpy(pictures.astype(np.float32), weights))


def by_numpy(pictures: Single, weights: Single) -> Single:
    trust = weights
    for _ in range(MEAN_PASSES):
        total = np.maximum(trust.sum(0), np.float32(1e-6))
        mean = (pictures * trust[..., None]).sum(0) / total[..., None]
        blue, green, red = np.moveaxis(pictures - mean, -1, 0)
        away = (blue + green + red) / 3
        trust = cauchy_weight(away, np.float32(HALF_WEIGHT_GREY), weights)
    return np.asarray(mean, np.float32)
