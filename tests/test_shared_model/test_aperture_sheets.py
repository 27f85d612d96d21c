"""The sheets between lips and between eyelids follow their rims."""

import numpy as np

from shared_model.animate import Face, Identity
from shared_model.aperture_sheets import (
    BEHIND_MM,
    EYES,
    MOUTH,
    SHEETS,
    ApertureSheet,
    head_with_aperture_sheets,
    rim_weights,
)
from shared_model.mesh import PARTS, generic_head, open_edges
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

HEAD, WITH_SHEETS = generic_head(), head_with_aperture_sheets()
COUNT = len(HEAD.vertices)


def triangles_of(sheet: ApertureSheet) -> np.ndarray:
    ours = WITH_SHEETS.parts[WITH_SHEETS.triangles[:, 0]] == PARTS.index(sheet.part)
    return np.asarray(WITH_SHEETS.triangles[ours])


def animated(**actuators: float) -> np.ndarray:
    eau = np.zeros(len(EAUS))
    for name, value in actuators.items():
        eau[EAU_INDEX[name]] = value
    face = Face(WITH_SHEETS, Identity(np.zeros(len(AAUS)), np.zeros_like(WITH_SHEETS.vertices)))
    return face.animate(eau)


def frontal_mm2(sheet: ApertureSheet, vertices: np.ndarray) -> float:
    """What the sheet covers, seen from the front; parts that are turned over count as negative."""
    a, b, c = (vertices[triangles_of(sheet)[:, i]] for i in range(3))
    return float(np.cross(b - a, c - a)[:, 2].sum() / 2)


def test_the_head_itself_is_unchanged() -> None:
    np.testing.assert_array_equal(WITH_SHEETS.vertices[:COUNT], HEAD.vertices)
    np.testing.assert_array_equal(WITH_SHEETS.eau_up[:, :COUNT], HEAD.eau_up)
    np.testing.assert_array_equal(WITH_SHEETS.aau[:, :COUNT], HEAD.aau)
    assert WITH_SHEETS.landmarks == HEAD.landmarks
    assert np.all(WITH_SHEETS.opacity[:COUNT] >= HEAD.opacity)


def test_the_generic_mouth_and_eyes_are_not_drawn() -> None:
    old = WITH_SHEETS.triangles[(WITH_SHEETS.triangles < COUNT).all(1)]
    assert np.all(HEAD.parts[old] == PARTS.index("skin"))
    for sheet in SHEETS:
        assert np.all(triangles_of(sheet) >= COUNT)
        assert len(triangles_of(sheet)) == 2 * (len(sheet.upper) - 1)


def test_rims_lie_on_points_of_the_network_or_on_the_edge_of_the_skin() -> None:
    weights = rim_weights(HEAD)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)
    points = [point for sheet in SHEETS for point in (*sheet.upper, *sheet.lower)]
    ends = open_edges(WITH_SHEETS.triangles[(WITH_SHEETS.triangles < COUNT).all(1)])
    for row, point in enumerate(points):
        if point in (MOUTH.upper[0], MOUTH.upper[-1]):
            assert weights[row].argmax() in ends and weights[row].max() == 1
            continue
        corners = HEAD.triangles[HEAD.network_triangles[point]]
        expected = HEAD.network_weights[point] @ HEAD.vertices[corners]
        np.testing.assert_allclose(weights[row] @ HEAD.vertices, expected, atol=1e-6)


def test_a_sheet_is_behind_its_rims_for_all_actuators_except_at_the_corners() -> None:
    weights = rim_weights(HEAD)
    rims = [rim for sheet in SHEETS for rim in (sheet.upper, sheet.lower)]
    depths_mm = [[0, *[BEHIND_MM] * (len(rim) - 2), 0] for rim in rims]
    expected = np.outer(np.concatenate(depths_mm), [0, 0, 1])
    for setting in ({}, {"jaw_drop": 1.0}, {"mouth_corners": 1.0, "lid_left": -0.5}):
        vertices = animated(**setting)
        behind = weights @ vertices[:COUNT] - vertices[COUNT:]
        np.testing.assert_allclose(behind, expected, atol=1e-6)


def test_closed_lips_leave_the_sheet_no_area_and_an_open_jaw_extends_it() -> None:
    opened = frontal_mm2(MOUTH, animated(jaw_drop=1))
    assert opened > 400 and frontal_mm2(MOUTH, animated()) < 0.05 * opened


def test_closed_eyelids_leave_the_sheet_of_their_own_eye_no_area() -> None:
    left, right = EYES
    opened, closed = animated(), animated(lid_left=1)
    assert frontal_mm2(left, opened) > 150
    assert frontal_mm2(left, closed) < 0.2 * frontal_mm2(left, opened)
    assert abs(frontal_mm2(right, closed) - frontal_mm2(right, opened)) < 1


def test_open_sheets_face_outwards() -> None:
    vertices = animated(jaw_drop=1)
    for sheet in SHEETS:
        a, b, c = (vertices[triangles_of(sheet)[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        assert np.all(normals[np.linalg.norm(normals, axis=1) > 1, 2] > 0)


def test_the_eyes_fill_the_holes_between_the_eyelids_in_the_atlas() -> None:
    for sheet in EYES:
        vertices = np.unique(triangles_of(sheet))
        low, high = (
            WITH_SHEETS.texture_coordinates[vertices].min(0),
            WITH_SHEETS.texture_coordinates[vertices].max(0),
        )
        corner = HEAD.landmarks["en_l" if sheet.part == "eye_left" else "en_r"]
        away = HEAD.texture_coordinates[corner] - (low + high) / 2
        assert np.all(np.abs(away) < (high - low)), sheet.part


def test_the_points_of_the_network_are_unchanged() -> None:
    known = (HEAD.network_triangles >= 0) & (WITH_SHEETS.network_triangles >= 0)
    assert known.sum() > 430
    before = HEAD.triangles[HEAD.network_triangles[known]]
    after = WITH_SHEETS.triangles[WITH_SHEETS.network_triangles[known]]
    np.testing.assert_array_equal(before, after)
