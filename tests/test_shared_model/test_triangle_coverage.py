"""Grid points within triangles: which, and where in them."""

import numpy as np
import pytest

from shared_model.appearance import covered_points
from shared_model.arrays import Array


def test_a_triangle_covers_its_points_with_their_weights() -> None:
    corners = np.array([[[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]])
    triangle, x, y, shares = covered_points(corners, 8, 8)
    assert sorted(zip(x.tolist(), y.tolist(), strict=True)) == [
        (i, j) for i in range(4) for j in range(4) if i + j <= 3
    ]
    assert not triangle.any()
    np.testing.assert_allclose(shares @ corners[0], np.stack([x, y], 1), atol=1e-12)


@pytest.mark.parametrize(
    "corners",
    [
        [[1.0, 1.0], [5.0, 5.0], [3.0, 3.0]],  # flat
        [[1.2, 1.2], [1.8, 1.3], [1.4, 1.9]],  # between the points
        [[-9.0, 1.0], [-4.0, 1.0], [-4.0, 6.0]],  # beside the grid
        [[2.0, 20.0], [6.0, 20.0], [2.0, 26.0]],  # below it
    ],
)
def test_triangles_without_grid_points_cover_none(corners: list[list[float]]) -> None:
    found = covered_points(np.array([corners]), 8, 6)
    assert [len(part) for part in found] == [0, 0, 0, 0]


def test_triangles_of_all_sizes_are_cut_off_at_the_grid() -> None:
    rng = np.random.default_rng(4)
    sizes = rng.choice([0.5, 2, 9, 40], 300)[:, None, None]
    corners = rng.uniform(-5, 25, (300, 1, 2)) + sizes * rng.normal(size=(300, 3, 2))
    triangle, x, y, shares = covered_points(corners, 20, 12)
    assert x.min() >= 0 and x.max() <= 19 and y.min() >= 0 and y.max() <= 11
    expected = {
        (n, i, j)
        for n, (a, b, c) in enumerate(corners)
        for i in range(20)
        for j in range(12)
        if same_side(a, b, c, np.array([i, j], float))
    }
    assert set(zip(triangle.tolist(), x.tolist(), y.tolist(), strict=True)) == expected
    assert shares.min() > -1e-6


def same_side(a: Array, b: Array, c: Array, point: Array) -> bool:
    """Whether a point lies on the same side of all three edges."""
    sides = [
        float((q[0] - p[0]) * (point[1] - p[1]) - (q[1] - p[1]) * (point[0] - p[0]))
        for p, q in ((a, b), (b, c), (c, a))
    ]
    return min(sides) >= 0 or max(sides) <= 0
