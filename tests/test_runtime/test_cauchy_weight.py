"""The larger a residual, the less it counts."""

import numpy as np
import pytest

from runtime.cauchy_weight import HALF_WEIGHT_GREY, cauchy_weight


def test_a_residual_of_the_scale_counts_half_and_none_counts_as_before() -> None:
    residual = np.array([0, HALF_WEIGHT_GREY, -3 * HALF_WEIGHT_GREY], np.float32)
    assert cauchy_weight(residual).tolist() == pytest.approx([1, 0.5, 0.1])
    before = np.array([0.5, 0, 2], np.float32)
    assert cauchy_weight(residual, weight=before).tolist() == pytest.approx([0.5, 0, 0.2])
    assert cauchy_weight(residual, 36.0).tolist() == pytest.approx([1, 0.9, 0.5])
    assert cauchy_weight(residual, weight=before).dtype == np.float32
