"""Edges of the head fade over a pixel; hidden and transparent ones show nowhere."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_heads import drawn_picture
from heads import synthetic_head

from decoder.rendering.edge_strips import edges_of
from decoder.rendering.renderer import Renderer
from shared_model.arrays import Array, Mask
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS, Head

CAMERA = Camera(160, 120, 190.0)
# Turned in the plane of the picture: no edge is along its rows.
POSE = pose_from_euler(0, 0, 17, np.array([3.0, -2.0, 500.0]))
EXPANSION_PX = 0.7
BEHIND, NEAR, FAR = 40, 240, 120


def squares(halves_mm: tuple[float, ...], depths_mm: tuple[float, ...], opacity: float = 1) -> Head:
    """Separate squares, the first of skin, the others of teeth: each has a texel of its own."""
    offsets = np.array([(-1, 1, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 0)], dtype=np.float64)
    count = len(halves_mm)
    corners = [
        half * offsets + np.array((0, 0, depth))
        for half, depth in zip(halves_mm, depths_mm, strict=True)
    ]
    first = 4 * np.arange(count)[:, None]
    triangles = np.concatenate([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    middles = (np.arange(count) + 0.5) / count
    return replace(
        synthetic_head(4, 6),
        vertices=np.concatenate(corners),
        triangles=triangles.astype(np.int32),
        texture_coordinates=np.repeat(np.stack([middles, np.full(count, 0.5)], 1), 4, axis=0),
        parts=np.repeat([PARTS.index(name) for name in ("skin", "teeth_upper")[:count]], 4).astype(
            np.uint8
        ),
        opacity=np.full(4 * count, float(opacity)),
    )


def drawn(head: Head, expansion_px: float = EXPANSION_PX) -> Array:
    """(h, w) grey levels of squares before an even background."""
    greys = np.array([NEAR, FAR][: len(head.vertices) // 4], np.uint8)
    u, v = np.linspace(-0.5, 159.5, 3), np.linspace(-0.5, 119.5, 3)
    with Renderer(CAMERA.width, CAMERA.height, head) as renderer:
        renderer.set_texture(np.repeat(greys[None, :, None], 3, axis=2))
        still = np.full((120, 160, 3), BEHIND, np.uint8)
        renderer.set_background(still, np.stack(np.meshgrid(u, v), -1))
        picture = drawn_picture(renderer, CAMERA, POSE, head.vertices, expansion_px=expansion_px)
    return picture[..., 0].astype(np.float64)


def distances_px(corners_mm: Array) -> tuple[Array, Mask]:
    """(h, w) how far each pixel is beyond a square; and whether it is near one side of it alone."""
    corners = pixel_from_head(CAMERA, POSE, corners_mm)
    pixels = np.stack(np.meshgrid(np.arange(160), np.arange(120)), -1)
    middle = corners.mean(0)
    sides = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
        normal *= np.sign((a - middle) @ normal)
        sides.append((pixels - a) @ normal)
    ordered = np.sort(sides, axis=0)
    return ordered[-1], (np.abs(ordered[-1]) < 3) & (ordered[-2] < -4)


def test_the_outline_covers_each_pixel_by_its_share_and_is_expanded() -> None:
    head = squares((40.0,), (0.0,))
    distance, one_side = distances_px(head.vertices)
    share = np.clip(EXPANSION_PX + 0.5 - distance, 0, 1)
    expected = BEHIND + (NEAR - BEHIND) * share
    picture = drawn(head)
    assert one_side.sum() > 300 and ((share > 0.2) & (share < 0.8) & one_side).sum() > 30
    np.testing.assert_allclose(picture[one_side], expected[one_side], atol=8)
    # Corners are rounded or cut by less than a pixel.
    assert np.abs(picture - expected)[np.abs(distance) > 2].max() <= 1


def test_a_contour_before_the_head_itself_is_smooth_and_not_expanded() -> None:
    head = squares((25.0, 60.0), (30.0, 0.0))
    distance, one_side = distances_px(head.vertices[:4])
    share = np.where(distance < 0, 1, np.clip(0.5 - distance, 0, 1))
    expected = FAR + (NEAR - FAR) * share
    # Away from where the distance is so small that either may be drawn.
    certain = one_side & (np.abs(distance) > 0.02)
    np.testing.assert_allclose(drawn(head)[certain], expected[certain], atol=8)


def test_an_edge_behind_the_head_shows_nowhere() -> None:
    front = squares((40.0,), (30.0,))
    both = squares((40.0, 20.0), (30.0, 0.0))
    np.testing.assert_array_equal(drawn(both), drawn(front))


def test_a_transparent_edge_shows_nowhere() -> None:
    assert (drawn(squares((40.0,), (0.0,), opacity=0)) == BEHIND).all()


def test_without_expansion_no_edge_is_drawn() -> None:
    assert set(np.unique(drawn(squares((40.0,), (0.0,)), 0.0))) == {BEHIND, NEAR}


@pytest.mark.parametrize("opacity", [0, 1])
def test_each_edge_has_the_triangles_at_it(opacity: float) -> None:
    mesh = edges_of(squares((40.0, 20.0), (30.0, 0.0), opacity))
    edges, outside = mesh.edges, mesh.outside
    if not opacity:
        assert len(edges) == 0
        return
    assert (len(edges), outside) == (10, 5)
    assert (edges[:outside, 1:3] < 4).all()
    inner = edges[edges[:, 3] >= 0]
    assert {frozenset(ends) for ends in inner[:, 1:3]} == {frozenset((0, 2)), frozenset((4, 6))}
    assert {frozenset(found) for found in inner[:, [0, 3]]} == {
        frozenset((0, 2)),
        frozenset((1, 3)),
    }
