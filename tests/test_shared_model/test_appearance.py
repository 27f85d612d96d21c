"""The shape-free frame: every texel has its own point of the head."""

import numpy as np
import pytest
from heads import synthetic_head

from shared_model.appearance import atlas_of, resized
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


def test_an_image_of_the_same_size_is_unchanged() -> None:
    image = np.random.default_rng(0).random((8, 8, 3)).astype(np.float32)
    assert resized(image, 8) is image


def test_enlarging_preserves_constants_and_ramps() -> None:
    plain = np.full((6, 6, 2), 3.0, np.float32)
    np.testing.assert_allclose(resized(plain, 15), np.full((15, 15, 2), 3.0), atol=1e-6)
    slope = np.broadcast_to((np.arange(8, dtype=np.float32) + 0.5)[:, None, None], (8, 8, 1))
    rows = resized(slope, 16)[:, 0, 0]
    # The outermost centres of the large image lie outside those of the small one: edges repeat.
    np.testing.assert_allclose(rows[1:-1], (np.arange(16) + 0.5)[1:-1] / 2, atol=1e-6)
    assert rows[0] == 0.5 and rows[-1] == 7.5


def test_columns_are_enlarged_as_rows_are() -> None:
    image = np.random.default_rng(1).random((7, 7, 3)).astype(np.float32)
    turned = resized(np.ascontiguousarray(image.transpose(1, 0, 2)), 19)
    np.testing.assert_allclose(resized(image, 19), turned.transpose(1, 0, 2), atol=1e-6)
