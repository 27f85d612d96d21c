"""The shape-free frame: every texel has its own point of the head."""

import numpy as np
import pytest
from heads import synthetic_head

from shared_model.appearance import atlas_of
from shared_model.mesh import PARTS, generic_head

SIZES = (32, 96)


@pytest.mark.parametrize("size", SIZES)
def test_a_texel_lies_on_the_point_of_the_head_with_its_texture_coordinates(size: int) -> None:
    head = generic_head()
    atlas = atlas_of(head, size)
    found = atlas.points(head.texture_coordinates)
    centres = (np.stack([atlas.columns, atlas.rows], 1) + 0.5) / size
    np.testing.assert_allclose(found, centres, atol=1e-6)


@pytest.mark.parametrize("size", SIZES)
def test_weights_lie_inside_their_triangles_and_texels_come_once(size: int) -> None:
    atlas = atlas_of(generic_head(), size)
    assert atlas.weights.min() > -1e-6
    np.testing.assert_allclose(atlas.weights.sum(1), 1, atol=1e-9)
    assert len(set(zip(atlas.rows.tolist(), atlas.columns.tolist(), strict=True))) == len(
        atlas.rows
    )


def test_all_of_the_shown_face_has_texels_and_the_hidden_skull_has_none() -> None:
    head = generic_head()
    atlas = atlas_of(head, 128)
    shown = head.opacity[atlas.corners].max(1)
    assert shown.min() > 0
    used = set(atlas.corners.ravel().tolist())
    face = np.flatnonzero((head.opacity == 1) & (head.parts == PARTS.index("skin")))
    assert len(used & set(face.tolist())) > 0.9 * len(face)


def test_points_interpolate_any_value_over_the_triangles() -> None:
    head = synthetic_head()
    atlas = atlas_of(head, 48)
    linear = head.texture_coordinates @ np.array([[2.0], [-3.0]]) + 1
    u, v = (atlas.columns + 0.5) / 48, (atlas.rows + 0.5) / 48
    np.testing.assert_allclose(atlas.points(linear)[:, 0], 2 * u - 3 * v + 1, atol=1e-6)
