"""What is transparent of a mesh is not drawn, and what is solid is not blended."""

import numpy as np
import pytest

from decoder.rendering.render_geometry import grid_triangles, shown_triangles
from shared_model.arrays import Picture, VertexIndices

SIDE, CELLS = 64, 8
TRIANGLES = grid_triangles(CELLS + 1, CELLS + 1)
COORDINATES = (
    np.stack(np.meshgrid(*[np.linspace(0, 1, CELLS + 1)] * 2), axis=-1)
    .reshape(-1, 2)
    .astype(np.float32)
)


def picture_with(alpha: Picture) -> Picture:
    return np.dstack([np.zeros((SIDE, SIDE, 3), np.uint8), alpha])


def texels(triangle: VertexIndices) -> tuple[slice, slice]:
    """Rows and columns that bilinear interpolation may read within a triangle."""
    corners = COORDINATES[triangle] * SIDE
    (left, top), (right, bottom) = corners.min(0).astype(int), corners.max(0).astype(int)
    return slice(max(top - 1, 0), bottom + 1), slice(max(left - 1, 0), right + 1)


@pytest.mark.parametrize("seed", range(3))
def test_each_triangle_is_where_the_alpha_under_it_puts_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    alpha = np.repeat(np.repeat(rng.choice([0, 255], (4, 4)), 16, 0), 16, 1).astype(np.uint8)
    alpha[20:23, 40:42] = 100
    solid, blended = shown_triangles(TRIANGLES, COORDINATES, picture_with(alpha))
    kinds = {tuple(triangle): "solid" for triangle in solid}
    kinds |= {tuple(triangle): "blended" for triangle in blended}
    assert len(kinds) == len(solid) + len(blended)
    for triangle in TRIANGLES:
        under = alpha[texels(triangle)]
        kind = kinds.get(tuple(triangle))
        assert kind != "solid" or (under == 255).all()
        assert kind is not None or (under == 0).all()


def test_a_solid_middle_is_not_blended_and_a_clear_edge_is_not_drawn() -> None:
    alpha = np.zeros((SIDE, SIDE), np.uint8)
    alpha[16:48, 16:48] = 255
    solid, blended = shown_triangles(TRIANGLES, COORDINATES, picture_with(alpha))
    assert len(solid) > 0
    assert len(solid) + len(blended) < len(TRIANGLES)


def test_a_picture_without_alpha_is_solid() -> None:
    solid, blended = shown_triangles(TRIANGLES, COORDINATES, np.zeros((SIDE, SIDE, 3), np.uint8))
    assert np.array_equal(solid, TRIANGLES)
    assert not len(blended)


def test_of_a_picture_that_is_all_clear_one_triangle_is_left() -> None:
    clear = picture_with(np.zeros((SIDE, SIDE), np.uint8))
    solid, blended = shown_triangles(TRIANGLES, COORDINATES, clear)
    assert (len(solid), len(blended)) == (0, 1)
