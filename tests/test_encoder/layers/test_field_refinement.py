"""The normal equations of motion fields: compiled loops against NumPy."""

import numpy as np
import pytest

from encoder.layers.field_refinement import add_fields, add_pixels

ROWS, COLUMNS = 4, 5
POINTS = ROWS * COLUMNS
RANDOM = np.random.default_rng(6)


def shape_functions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners and their shares (4, count) of random positions on the grid."""
    row, column = RANDOM.integers(0, ROWS - 1, count), RANDOM.integers(0, COLUMNS - 1, count)
    first = row * COLUMNS + column
    corners = np.array([first, first + 1, first + COLUMNS, first + COLUMNS + 1])
    return corners, RANDOM.uniform(0, 1, (4, count))


@pytest.mark.parametrize("count", [0, 50])
def test_pixels_add_the_products_of_their_slopes_at_their_corners(count: int) -> None:
    corners, shares = shape_functions(count)
    slopes, weights = RANDOM.normal(0, 5, (count, 2)), RANDOM.uniform(0, 1, count)
    errors = RANDOM.normal(0, 5, count).astype(np.float32)
    at_points = np.zeros((count, POINTS))
    at_points[np.arange(count), corners] = shares
    rows = slopes[:, :, None] * at_points[:, None]
    squares, products = np.zeros((2, 2, POINTS, POINTS)), np.zeros((2, POINTS))
    add_pixels(squares, products, corners, shares, slopes * weights[:, None], slopes, errors)
    expected = np.einsum("m,mxp,myq->xypq", weights, rows, rows)
    expected[1, 0] = 0
    assert np.allclose(squares, expected)
    assert np.allclose(products, np.einsum("m,mxp,m->xp", weights, rows, errors))


def test_a_frame_counts_in_all_pairs_of_fields() -> None:
    row, column = np.divmod(np.arange(POINTS), COLUMNS)
    near = (abs(row[:, None] - row) <= 1) & (abs(column[:, None] - column) <= 1)
    squares = RANDOM.normal(0, 1, (2, 2, POINTS, POINTS)) * near
    unit, normal = RANDOM.normal(0, 1, 3), np.ones((3, 2, POINTS, 3, 2, POINTS))
    add_fields(normal, unit, squares, COLUMNS)
    assert np.allclose(normal - 1, np.einsum("k,l,xypq->kxplyq", unit, unit, squares))
