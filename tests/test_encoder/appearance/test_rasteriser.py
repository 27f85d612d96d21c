"""The rasteriser: the nearest front-facing triangle in each pixel."""

import numpy as np

from encoder.appearance.rasteriser import rasterise
from shared_model.arrays import Array, Mask, VertexIndices

FOCAL_PX = 100.0


def project(points: Array) -> Array:
    return np.asarray(FOCAL_PX * points[:, :2] / points[:, 2:])


# Two rectangles that lean away from the camera, the second behind the first but wider; y is down.
FIRST = np.array([[2.0, 2, 100], [2, 20, 130], [20, 20, 130], [20, 2, 100]])
SECOND = FIRST * [1, 1, 0] * 2 + [0, 0, 180]
POINTS = np.concatenate([FIRST, SECOND])
# Counter-clockwise seen from the camera, whose y points down.
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
WHOLE = np.ones((24, 24), bool)


def shown_points(wanted: Mask, triangles: VertexIndices) -> dict[int, Array]:
    """What each pixel shows: a place in space."""
    surface = rasterise(project(POINTS), POINTS[:, 2], triangles, wanted)
    places = surface.interpolate(POINTS.T.astype(np.float32)).T.astype(np.float64)
    return dict(zip(surface.pixels.tolist(), places, strict=True))


def test_each_fragment_is_the_point_that_projects_onto_its_pixel() -> None:
    shown = shown_points(WHOLE, TRIANGLES)
    assert len(shown) > 250 and list(shown) == sorted(shown)
    pixels, places = np.array(list(shown)), np.array(list(shown.values()))
    expected = np.stack([pixels % 24, pixels // 24], 1)
    np.testing.assert_allclose(project(places), expected, atol=1e-4)


def test_the_nearest_triangle_wins_in_any_order() -> None:
    for triangles in (TRIANGLES, TRIANGLES[::-1]):
        shown = shown_points(WHOLE, triangles)
        assert shown[10 * 24 + 10][2] < 150
        assert shown[21 * 24 + 21][2] > 170


def test_back_faces_are_culled() -> None:
    backs = TRIANGLES[:, ::-1].copy()
    assert not shown_points(WHOLE, backs)
    mixed = np.concatenate([backs[:2], TRIANGLES[2:]])
    assert min(place[2] for place in shown_points(WHOLE, mixed).values()) > 170


def test_only_pixels_of_the_mask_are_covered() -> None:
    wanted = np.zeros((24, 24), bool)
    wanted[9:12, 9:12] = True
    assert list(shown_points(wanted, TRIANGLES)) == np.flatnonzero(wanted).tolist()
