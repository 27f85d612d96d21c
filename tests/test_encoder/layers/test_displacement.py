"""Sums and products of vector fields in compiled loops."""

import numpy as np

from encoder.layers.displacement import dot, moved_back

RANDOM = np.random.default_rng(8)
FIELDS = RANDOM.normal(0, 3, (4, 5, 7, 2)).astype(np.float32)
VECTORS = RANDOM.normal(0, 3, (5, 7, 2)).astype(np.float32)


def test_dot_is_the_scalar_product_at_each_pixel() -> None:
    np.testing.assert_allclose(dot(FIELDS, VECTORS), (FIELDS * VECTORS).sum(-1), rtol=1e-4)


def test_positions_are_moved_back_by_the_sum_of_the_fields() -> None:
    own = np.array([0.5, -1.0, 0.0, 2.0])
    expected = VECTORS - 0.5 * FIELDS[0] + FIELDS[1] - 2 * FIELDS[3]
    np.testing.assert_allclose(moved_back(VECTORS, own, FIELDS), expected, rtol=0, atol=1e-4)


def test_without_fields_positions_stay() -> None:
    np.testing.assert_array_equal(moved_back(VECTORS, np.zeros(0), FIELDS[:0]), VECTORS)
