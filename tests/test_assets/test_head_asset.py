"""The steps that build the head: gradients, weights and symmetry, without the wheel."""

import numpy as np
import pytest

from assets.head_asset.atlas import mean_value_weights
from assets.head_asset.chart import dirichlet, flat_shapes
from assets.head_asset.correspond import closest_point, mirror_pairs, robust_mean
from assets.head_asset.decimate import decimate
from assets.head_asset.makehuman import mirror_index
from assets.head_asset.mesh_parts import EYE_LEFT, EYE_RIGHT, SKIN, Mesh, eyeball
from assets.head_asset.raster import rasterise

RNG = np.random.default_rng(11)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def bumpy_sheet(columns: int = 21, rows: int = 15) -> Mesh:
    """A symmetric sheet of skin over x in [-10, 10] with a bump off its middle line."""
    x, y = np.meshgrid(np.arange(columns) - columns // 2, np.arange(rows))
    z = 3 * np.exp(-((np.abs(x) - 5) ** 2 + (y - 7) ** 2) / 8)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(float)
    mirror = mirror_index(vertices)
    left = []
    for j in range(rows - 1):
        for i in range(columns // 2, columns - 1):
            a, b = j * columns + i, (j + 1) * columns + i
            left += [(a, a + 1, b + 1), (a, b + 1, b)]
    half = np.array(left)
    triangles = np.concatenate([half, mirror[half][:, [0, 2, 1]]])
    return Mesh(vertices, triangles, np.full(len(vertices), SKIN, np.uint8), mirror, {}, {})


def test_the_gradient_of_the_flattening_energy_agrees_with_differences() -> None:
    shapes = flat_shapes(RNG.normal(size=(2, 3, 3)), np.ones(2))
    inverse = np.asarray(np.linalg.inv(shapes), np.float64)
    area = np.array([0.3, 0.7])
    flat = SQUARE + RNG.normal(0, 0.05, SQUARE.shape)
    _, gradient = dirichlet(flat, HALVES, inverse, area)
    for index in np.ndindex(flat.shape):
        step = np.zeros_like(flat)
        step[index] = 1e-6
        above, below = (dirichlet(flat + s, HALVES, inverse, area)[0] for s in (step, -step))
        assert gradient[index] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-4)


def test_a_flipped_triangle_has_a_prohibitive_energy() -> None:
    inverse = np.tile(np.eye(2), (2, 1, 1))
    assert dirichlet(SQUARE, HALVES[:, ::-1], inverse, np.ones(2))[0] > 1e9


def test_mean_value_weights_reproduce_the_point_and_sum_to_one() -> None:
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    outline = np.stack([3 * np.cos(turn), np.sin(turn)], 1)
    for place in ((0.2, 0.1), (-2.0, 0.3), (2.6, 0.0)):
        weights = mean_value_weights(np.array(place), outline)
        assert weights.sum() == pytest.approx(1)
        np.testing.assert_allclose(weights @ outline, place, atol=1e-9)


def test_decimation_keeps_symmetry_borders_and_locked_vertices() -> None:
    mesh = bumpy_sheet()
    locked = np.zeros(len(mesh.vertices), bool)
    locked[7 * 21 + 13] = True
    thin = decimate(mesh, np.ones(len(mesh.vertices)), locked, {SKIN: 120})
    assert len(thin.vertices) < 0.6 * len(mesh.vertices)
    np.testing.assert_array_equal(thin.vertices[thin.mirror], thin.vertices * [-1, 1, 1])
    places = {tuple(v) for v in thin.vertices}
    assert tuple(mesh.vertices[7 * 21 + 13]) in places
    assert {(x, y) for x, y, _ in places} >= {(x, 0) for x in range(-10, 11)}
    corners = thin.vertices[thin.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 2] > 0).all()


def test_eyeballs_mirror_vertex_by_vertex_and_face_outwards() -> None:
    ball = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * 15
    balls = [eyeball(ball + np.array([x, 17, 64])) for x in (31, -31)]
    np.testing.assert_allclose(balls[0][0] * [-1, 1, 1], balls[1][0], atol=1e-9)
    for (points, facets), part, x in zip(balls, (EYE_LEFT, EYE_RIGHT), (31, -31), strict=True):
        corners = points[facets]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outward = corners.mean(1) - [x, 17, 64]
        assert ((normal * outward).sum(1) > 0).all(), part


def test_robust_mean_leaves_outliers_and_distrusted_views_out() -> None:
    places = np.zeros((6, 1, 3)) + RNG.normal(0, 0.1, (6, 1, 3))
    places[4], places[5] = 30.0, -50.0
    trust = np.array([1, 1, 1, 1, 1, 0.01])[:, None]
    assert np.abs(robust_mean(places, trust)).max() < 0.2


def test_mirror_pairs_finds_twins_and_midline_points() -> None:
    points = np.array([[3.0, 1, 0], [0, 2, 0], [-3.1, 1, 0], [7, 0, 1], [-6.9, 0.1, 1]])
    np.testing.assert_array_equal(mirror_pairs(points), [2, 1, 0, 4, 3])


def test_closest_point_falls_on_face_edge_or_corner() -> None:
    vertices = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    triangles, allowed = np.array([[0, 1, 2]]), np.array([True])
    for point, expected in (
        ((1, 1, 5), (1, 1, 0)),
        ((2, -3, 0), (2, 0, 0)),
        ((-1, -2, 0), (0, 0, 0)),
    ):
        _, weights = closest_point(np.array(point, float), vertices, triangles, allowed)
        np.testing.assert_allclose(weights @ vertices, expected, atol=1e-9)


def test_the_nearer_of_two_triangles_is_seen() -> None:
    points = np.array([[1.0, 1], [9, 1], [1, 9], [0, 0], [10, 0], [0, 10]])
    depth = np.array([5.0, 5, 5, 7, 7, 7])
    hits = rasterise(points, depth, np.array([[3, 4, 5], [0, 1, 2]]), 11, 11)
    assert hits.triangle[3, 3] == 1 and hits.triangle[0, 5] == 0 and hits.triangle[10, 10] == -1
    np.testing.assert_allclose(hits.weights[3, 3] @ points[:3], (3, 3), atol=1e-9)
