"""The surround: behind the skin, moving with it, with strips of its own in the atlas."""

import cv2
import numpy as np
import pytest
from drawn_heads import drawn_picture

from decoder.rendering.renderer import Renderer
from shared_model.animate import Face, identity_from_controls
from shared_model.aperture_sheets import head_with_aperture_sheets
from shared_model.appearance import atlas_of
from shared_model.geometry import Camera, pose_from_euler
from shared_model.mesh import PARTS
from shared_model.parameters import AAUS, EAU_INDEX, EAUS
from shared_model.shape_residual import residual_basis
from shared_model.surround import (
    RINGS,
    STRIP_ROWS,
    STRIP_WIDTH,
    blend_surround_seam,
    head_with_surround,
    surround_anchors,
)

INNER, HEAD = head_with_aperture_sheets(), head_with_surround()
COUNT = len(INNER.vertices)
SURROUND = np.arange(COUNT, len(HEAD.vertices))
TRIANGLES = HEAD.triangles[HEAD.parts[HEAD.triangles[:, 0]] == PARTS.index("surround")]


def test_the_head_itself_is_unchanged() -> None:
    np.testing.assert_array_equal(HEAD.vertices[:COUNT], INNER.vertices)
    np.testing.assert_array_equal(HEAD.triangles[len(TRIANGLES) :], INNER.triangles)
    known = INNER.network_triangles >= 0
    np.testing.assert_array_equal(HEAD.network_triangles >= 0, known)
    np.testing.assert_array_equal(
        HEAD.triangles[HEAD.network_triangles[known]],
        INNER.triangles[INNER.network_triangles[known]],
    )


def test_the_surround_faces_the_camera_behind_all_visible_skin() -> None:
    a, b, c = (HEAD.vertices[TRIANGLES[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
    skin = (INNER.opacity > 0) & (INNER.parts == PARTS.index("skin"))
    assert HEAD.vertices[SURROUND, 2].max() < INNER.vertices[skin, 2].min()


def test_the_surround_is_symmetrical() -> None:
    left, right = np.split(HEAD.vertices[SURROUND], 2)
    np.testing.assert_allclose(left, right * [-1, 1, 1], atol=0.5)


def test_the_surround_begins_under_the_skin_and_fades_outwards() -> None:
    rings = HEAD.vertices[SURROUND, :2].reshape(2, len(RINGS), -1, 2)
    centre = rings[:, 0].mean((0, 1))
    radii = np.linalg.norm(rings - centre, axis=3)
    assert np.all(np.diff(radii, axis=1) > 0)
    opacity = HEAD.opacity[SURROUND].reshape(2, len(RINGS), -1)
    assert np.all(opacity[:, -1] == 0) and np.all(opacity[:, :, 0] == 0)
    assert np.all(opacity[:, 0, 2:] == 1)


def test_the_surround_moves_with_the_skin_next_to_it() -> None:
    aau = np.linspace(-0.5, 0.5, len(AAUS))
    control_mm = np.random.default_rng(1).normal(0, 3, (len(residual_basis(HEAD)), 3))
    eau = np.zeros(len(EAUS))
    eau[EAU_INDEX["jaw_drop"]] = 0.8
    face = Face(HEAD, identity_from_controls(HEAD, aau, control_mm))
    moved = face.animate(eau) - HEAD.vertices
    np.testing.assert_allclose(moved[SURROUND], moved[surround_anchors(INNER)], atol=1e-9)


def test_the_strips_of_the_surround_overlap_no_other_texels() -> None:
    atlas = atlas_of(HEAD, 256)
    owner = HEAD.parts[atlas.corners[:, 0]] == PARTS.index("surround")
    columns = np.unique(atlas.columns[owner])
    assert owner.sum() > 4000
    assert not np.isin(atlas.columns[~owner & (atlas.rows < 220)], columns).any()


def test_the_halves_of_the_surround_meet_without_a_seam() -> None:
    atlas = np.random.default_rng(2).uniform(0, 255, (256, 256, 3)).astype(np.float32)
    result = blend_surround_seam(atlas)
    rows, columns = np.nonzero((result != atlas).any(2))
    width, end = int(STRIP_WIDTH * 256), round(STRIP_ROWS[1] * 256)
    assert np.all((columns < width) | (columns >= 256 - width))
    assert 150 < rows.min() < 210 and rows.max() >= end
    left, right = result[:, :width], result[:, : -width - 1 : -1]
    np.testing.assert_allclose(left[end], right[end], atol=1e-3)
    share = (result - atlas)[rows.min() : end, 0, 0] / (atlas[:, -1] - atlas[:, 0])[
        rows.min() : end, 0
    ]
    assert np.all(np.diff(share) > 0) and share[0] < 0.03


@pytest.mark.parametrize(
    ("pitch_deg", "yaw_deg"), [(0, 0), (-25, 20), (20, 0), (20, 20), (20, -20)]
)
def test_nothing_behind_shows_within_the_outline(pitch_deg: float, yaw_deg: float) -> None:
    pose = pose_from_euler(pitch_deg, yaw_deg, 0, np.array([0.0, 0.0, 700.0]))
    eau = np.zeros(len(EAUS))
    eau[EAU_INDEX["jaw_drop"]] = 0.7
    control_mm = np.zeros((len(residual_basis(HEAD)), 3))
    face = Face(HEAD, identity_from_controls(HEAD, np.zeros(len(AAUS)), control_mm))
    with Renderer(480, 480, HEAD) as renderer:
        renderer.set_texture(np.full((64, 64, 3), 255, np.uint8))
        picture = drawn_picture(renderer, Camera(480, 480, 900.0), pose, face.animate(eau))
    behind = (picture[..., 0] < 128).astype(np.uint8)
    count, _ = cv2.connectedComponents(behind, connectivity=4)
    # The drawn head, and one region around it.
    assert count == 2
