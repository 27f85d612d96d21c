"""The sheet between the lips hangs on their rims and opens with them, in place of the mouth."""

import numpy as np

from shared_model.animate import Face, Identity
from shared_model.mesh import PARTS, generic_head
from shared_model.mouth_sheet import BEHIND_MM, LOWER_RIM, UPPER_RIM, mouth_sheet_head, rim_weights
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

HEAD, SHEETED = generic_head(), mouth_sheet_head()
COUNT, ROW = len(HEAD.vertices), len(UPPER_RIM)
SHEET = SHEETED.triangles[(SHEETED.triangles >= COUNT).any(1)]


def animated(**actuators: float) -> np.ndarray:
    eau = np.zeros(len(EAUS))
    for name, value in actuators.items():
        eau[EAU_INDEX[name]] = value
    face = Face(SHEETED, Identity(np.zeros(len(AAUS)), np.zeros_like(SHEETED.vertices)))
    return face.animate(eau)


def frontal_mm2(vertices: np.ndarray) -> float:
    """What the sheet covers, seen from the front; parts that are turned over count as negative."""
    a, b, c = (vertices[SHEET[:, i]] for i in range(3))
    return float(np.cross(b - a, c - a)[:, 2].sum() / 2)


def test_the_head_itself_stays_as_it_is() -> None:
    np.testing.assert_array_equal(SHEETED.vertices[:COUNT], HEAD.vertices)
    np.testing.assert_array_equal(SHEETED.eau_up[:, :COUNT], HEAD.eau_up)
    np.testing.assert_array_equal(SHEETED.aau[:, :COUNT], HEAD.aau)
    assert SHEETED.landmarks == HEAD.landmarks
    assert np.all(SHEETED.opacity[:COUNT] >= HEAD.opacity)


def test_nothing_of_the_old_mouth_is_drawn() -> None:
    inside = [PARTS.index(name) for name in ("teeth_upper", "teeth_lower", "tongue", "mouth")]
    old = SHEETED.triangles[(SHEETED.triangles < COUNT).all(1)]
    assert not np.isin(HEAD.parts[old[:, 0]], inside).any()
    assert np.all(SHEET >= COUNT) and len(SHEET) == 2 * (ROW - 1)


def test_rim_weights_find_the_points_of_the_network() -> None:
    weights = rim_weights(HEAD)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)
    for row, point in enumerate((*UPPER_RIM, *LOWER_RIM)):
        corners = HEAD.triangles[HEAD.network_triangles[point]]
        expected = HEAD.network_weights[point] @ HEAD.vertices[corners]
        np.testing.assert_allclose(weights[row] @ HEAD.vertices, expected, atol=1e-6)


def test_the_sheet_hangs_behind_the_rims_in_every_setting() -> None:
    weights = rim_weights(HEAD)
    for setting in ({}, {"jaw_drop": 1.0}, {"mouth_corners": 1.0, "lip_stretch": -1.0}):
        vertices = animated(**setting)
        behind = weights @ vertices[:COUNT] - vertices[COUNT:]
        np.testing.assert_allclose(behind, np.tile([0, 0, BEHIND_MM], (2 * ROW, 1)), atol=1e-6)


def test_closed_lips_fold_the_sheet_to_nothing_and_an_open_jaw_spreads_it() -> None:
    opened = frontal_mm2(animated(jaw_drop=1))
    assert opened > 400 and frontal_mm2(animated()) < 0.05 * opened


def test_an_open_sheet_faces_outwards() -> None:
    vertices = animated(jaw_drop=1)
    a, b, c = (vertices[SHEET[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert np.all(normals[np.linalg.norm(normals, axis=1) > 1, 2] > 0)


def test_the_networks_points_lie_where_they_did() -> None:
    known = (HEAD.network_triangles >= 0) & (SHEETED.network_triangles >= 0)
    assert known.sum() > 440
    before = HEAD.triangles[HEAD.network_triangles[known]]
    after = SHEETED.triangles[SHEETED.network_triangles[known]]
    np.testing.assert_array_equal(before, after)
