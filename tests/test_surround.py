"""The sheet beside the face: behind the skin, moving with it, in strips of the atlas of its own."""

import numpy as np

from shared_model.animate import Face, identity_from_controls
from shared_model.appearance import atlas_of
from shared_model.mesh import PARTS
from shared_model.parameters import AAUS, EAU_INDEX, EAUS
from shared_model.residual import residual_basis
from shared_model.sheets import sheeted_head
from shared_model.surround import RINGS, sheet_holders, surrounded_head

INNER, HEAD = sheeted_head(), surrounded_head()
COUNT = len(INNER.vertices)
SHEET = np.arange(COUNT, len(HEAD.vertices))
TRIANGLES = HEAD.triangles[HEAD.parts[HEAD.triangles[:, 0]] == PARTS.index("surround")]


def test_the_head_itself_stays_as_it_is() -> None:
    np.testing.assert_array_equal(HEAD.vertices[:COUNT], INNER.vertices)
    np.testing.assert_array_equal(HEAD.triangles[len(TRIANGLES) :], INNER.triangles)
    known = INNER.network_triangles >= 0
    np.testing.assert_array_equal(HEAD.network_triangles >= 0, known)
    np.testing.assert_array_equal(
        HEAD.triangles[HEAD.network_triangles[known]],
        INNER.triangles[INNER.network_triangles[known]],
    )


def test_the_sheet_faces_the_camera_behind_all_skin_that_shows() -> None:
    a, b, c = (HEAD.vertices[TRIANGLES[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
    skin = (INNER.opacity > 0) & (INNER.parts == PARTS.index("skin"))
    assert HEAD.vertices[SHEET, 2].max() < INNER.vertices[skin, 2].min()


def test_it_is_the_same_on_both_sides() -> None:
    left, right = np.split(HEAD.vertices[SHEET], 2)
    np.testing.assert_allclose(left, right * [-1, 1, 1], atol=0.5)


def test_it_reaches_from_under_the_skin_outwards_and_fades() -> None:
    rings = HEAD.vertices[SHEET, :2].reshape(2, len(RINGS), -1, 2)
    centre = rings[:, 0].mean((0, 1))
    radii = np.linalg.norm(rings - centre, axis=3)
    assert np.all(np.diff(radii, axis=1) > 0)
    opacity = HEAD.opacity[SHEET].reshape(2, len(RINGS), -1)
    assert np.all(opacity[:, -1] == 0) and np.all(opacity[:, :, 0] == 0)
    assert np.all(opacity[:, 0, 2:] == 1)


def test_it_moves_with_the_skin_beside_it() -> None:
    aau = np.linspace(-0.5, 0.5, len(AAUS))
    control_mm = np.random.default_rng(1).normal(0, 3, (len(residual_basis(HEAD)), 3))
    eau = np.zeros(len(EAUS))
    eau[EAU_INDEX["jaw_drop"]] = 0.8
    face = Face(HEAD, identity_from_controls(HEAD, aau, control_mm))
    moved = face.animate(eau) - HEAD.vertices
    np.testing.assert_allclose(moved[SHEET], moved[sheet_holders(INNER)], atol=1e-9)


def test_its_strips_in_the_atlas_are_its_own() -> None:
    atlas = atlas_of(HEAD, 256)
    owner = HEAD.parts[atlas.corners[:, 0]] == PARTS.index("surround")
    columns = np.unique(atlas.columns[owner])
    assert owner.sum() > 4000
    assert not np.isin(atlas.columns[~owner & (atlas.rows < 220)], columns).any()
