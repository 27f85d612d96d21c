"""The person's own motion: fields over the whole picture, at the points of a mesh; a soft mask."""

import numpy as np
import pytest
from heads import synthetic_head

from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.head_motion import BackgroundMesh, make_background_mesh, warp
from shared_model.layers.layer_motion import fields_at_mesh, interpolation_matrix, own_motion
from shared_model.layers.soft_mask import opacity

CAMERA = Camera(160, 120, 200.0)
POSE = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 900.0]))


@pytest.fixture(scope="module")
def mesh() -> BackgroundMesh:
    head = synthetic_head(8, 10)
    return make_background_mesh(CAMERA, POSE, head, head.vertices)


def test_a_linear_field_is_linear_at_the_mesh(mesh: BackgroundMesh) -> None:
    down, across = np.mgrid[:4, :5] / np.array([3, 4])[:, None, None]
    fields = np.stack([2 * across + down, -across], -1)[None]
    at_mesh = fields_at_mesh(mesh, fields)
    u = (mesh.grid_px[..., 0] + 0.5) / CAMERA.width
    v = (mesh.grid_px[..., 1] + 0.5) / CAMERA.height
    np.testing.assert_allclose(at_mesh[0], np.stack([2 * u + v, -u], -1), atol=1e-12)


def test_points_between_two_are_means_of_both() -> None:
    expected = np.array([[1, 0], [0.5, 0.5], [0, 1]])
    np.testing.assert_allclose(interpolation_matrix(3, 2), expected)


def test_missing_coefficients_are_0_and_further_ones_are_of_no_field() -> None:
    fields = np.ones((2, 9, 9, 2))
    fields[1] *= 3
    one = own_motion(fields, np.array([2.0]))
    assert one[4, 4].tolist() == [2, 2]
    assert np.array_equal(own_motion(fields, np.array([2.0, 0.0, 99.0])), one)
    assert own_motion(fields, np.zeros(0)).shape == (9, 9, 2)


def test_nothing_comes_away_from_the_edges_of_the_picture() -> None:
    fields = np.ones((1, 9, 9, 2))
    for amount in (3.0, -3.0):
        motion = own_motion(fields, np.array([amount]))
        assert (motion[:, 0, 0] <= 0).all() and (motion[:, -1, 0] >= 0).all()
        assert (motion[0, :, 1] <= 0).all() and (motion[-1, :, 1] >= 0).all()
        assert motion[4, 4].tolist() == [amount, amount]


def test_own_motion_adds_to_that_of_the_head(mesh: BackgroundMesh) -> None:
    own = np.zeros((*mesh.grid_px.shape[:2], 2))
    own[3, 3] = 1.5, -0.5
    vertices = synthetic_head(8, 10).vertices
    np.testing.assert_allclose(
        warp(mesh, POSE, vertices, own) - warp(mesh, POSE, vertices), own, atol=1e-9
    )


def test_a_folding_motion_is_shortened(mesh: BackgroundMesh) -> None:
    own = np.zeros((*mesh.grid_px.shape[:2], 2))
    own[3, 3] = 500.0, 0.0
    vertices = synthetic_head(8, 10).vertices
    across = np.diff(warp(mesh, POSE, vertices, own)[..., 0], axis=1)
    assert (across > 0).all()


def test_a_mask_is_opaque_within_and_clear_outside() -> None:
    mask = np.zeros((96, 96), bool)
    mask[40:, 30:60] = True
    alpha = opacity(mask, 200, 150)
    assert alpha.shape == (150, 200)
    assert (alpha[75:, 75:112] == 1).all()
    assert (alpha[:50] == 0).all() and (alpha[:, :50] == 0).all()
    assert 0.2 < alpha[120, 62:64].mean() < 0.8
    assert (opacity(np.ones((96, 96), bool), 7, 5) == 1).all()
    assert (opacity(np.zeros((96, 96), bool), 7, 5) == 0).all()
