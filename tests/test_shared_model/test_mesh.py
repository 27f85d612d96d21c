"""The generic head: a sound symmetric mesh, an atlas without folds, anatomy in human ranges."""

from itertools import pairwise

import numpy as np
import pytest

from assets.head_asset.aau_fields import aau_fields
from shared_model.anatomy.expressions import eau_fields
from shared_model.arrays import Array, Integers, Mask, VertexIndices
from shared_model.mesh import PARTS, Head, generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

MIDLINE = (
    *("v", "tr", "on", "g", "n", "prn", "sn", "ls", "sto", "sto_upper"),
    *("sto_lower", "li", "sl", "pg", "gn", "op"),
)
PAIRED = (
    *("eu", "ft", "fz", "zy", "cdl", "t", "po", "go", "or"),
    *("sci", "en", "ex", "ps", "pi", "al", "ac", "ch", "cph"),
)
# Points of the landmark network, by the names its makers' figures give their places.
OUTER_EYE, INNER_EYE, MOUTH_CORNER = (263, 33), (362, 133), (291, 61)
NOSE_TIP, CHIN, FOREHEAD, UPPER_INNER_LIP, LOWER_INNER_LIP = 1, 152, 10, 13, 14
UPPER_LID, LOWER_LID, BROW = (386, 159), (374, 145), (334, 105)
TEXELS = 256


@pytest.fixture(scope="module")
def head() -> Head:
    return generic_head()


def part(head: Head, name: str) -> Mask:
    return np.asarray(head.parts == PARTS.index(name))


def place(head: Head, name: str) -> Array:
    return np.asarray(head.vertices[head.landmarks[name]])


def network_places(head: Head, vertices: Array) -> Array:
    corners = vertices[head.triangles[head.network_triangles]]
    return np.asarray((head.network_weights[..., None] * corners).sum(1))


def mirrored_rows(values: Array) -> Array:
    """Rows sorted, and the rows of the mirror image sorted: equal for a symmetric set."""
    flipped = values * ([-1] + [1] * (values.shape[1] - 1))
    return np.array([rows[np.lexsort(np.round(rows, 3).T)] for rows in (values, flipped)])


def signed_areas(points: Array, triangles: VertexIndices) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    ab, ac = b - a, c - a
    return np.asarray((ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2)


def texel_owners(head: Head, triangles: VertexIndices) -> Integers:
    """How many of the triangles cover the centre of each texel, borders left out."""
    count = np.zeros((TEXELS, TEXELS), np.int64)
    corners = head.texture_coordinates[triangles] * TEXELS - 0.5
    orientation = np.sign(signed_areas(head.texture_coordinates, triangles))
    for (a, b, c), sign in zip(corners, orientation, strict=True):
        low = np.floor(np.minimum(np.minimum(a, b), c)).astype(int)
        high = np.ceil(np.maximum(np.maximum(a, b), c)).astype(int)
        window = (slice(max(low[1], 0), high[1] + 1), slice(max(low[0], 0), high[0] + 1))
        v, u = np.mgrid[window]
        inside = np.ones(u.shape, bool)
        for p, q in pairwise((a, b, c, a)):
            inside &= sign * ((q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0])) > 1e-9
        count[window][: inside.shape[0], : inside.shape[1]] += inside[: count[window].shape[0]]
    return count


def test_indices_point_into_the_mesh(head: Head) -> None:
    n = len(head.vertices)
    assert 1500 <= n <= 2600
    assert head.triangles.min() == 0 and head.triangles.max() == n - 1
    assert len(np.unique(head.triangles)) == n
    assert all(0 <= index < n for index in head.landmarks.values())
    assert head.network_triangles.max() < len(head.triangles)
    assert head.parts.max() < len(PARTS)


def test_shapes_agree_with_the_contract(head: Head) -> None:
    n = len(head.vertices)
    assert head.eau_up.shape == head.eau_down.shape == (len(EAUS), n, 3)
    assert head.aau.shape == (len(AAUS), n, 3)
    assert head.texture_coordinates.shape == (n, 2) and head.opacity.shape == (n,)
    assert head.network_weights.shape == (468, 3)
    for array in (head.vertices, head.texture_coordinates, head.eau_up, head.eau_down, head.aau):
        assert np.isfinite(array).all()


def test_no_triangle_is_degenerate(head: Head) -> None:
    corners = head.vertices[head.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(normal, axis=1).min() / 2 > 0.005


def test_no_triangle_joins_two_parts(head: Head) -> None:
    parts = head.parts[head.triangles]
    assert (parts == parts[:, :1]).all()


@pytest.mark.parametrize("name", [name for name in PARTS if name != "surround"])
def test_every_part_is_there_and_symmetric(head: Head, name: str) -> None:
    twin = {"eye_left": "eye_right", "eye_right": "eye_left"}.get(name, name)
    here, there = head.vertices[part(head, name)], head.vertices[part(head, twin)]
    assert len(here) > 40
    ours, _ = mirrored_rows(here)
    _, theirs = mirrored_rows(there)
    np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_the_atlas_mirrors_with_the_head(head: Head) -> None:
    # Half a face's texture may stand in for the other half (Fig. 4.5).
    skin = part(head, "skin") & (head.opacity > 0)
    rows = np.column_stack([head.vertices[skin], head.texture_coordinates[skin]])
    flipped = rows * [-1, 1, 1, -1, 1] + [0, 0, 0, 1, 0]
    ours, theirs = (r[np.lexsort(np.round(r, 3).T)] for r in (rows, flipped))
    np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_the_front_of_the_atlas_has_no_fold_and_no_overlap(head: Head) -> None:
    front = np.isin(head.parts, [PARTS.index(p) for p in ("skin", "eye_left", "eye_right")])
    triangles = head.triangles[front[head.triangles[:, 0]]]
    areas = signed_areas(head.texture_coordinates, triangles)
    triangles = triangles[np.abs(areas) > 1e-9]
    # v runs down, so what is counter-clockwise on the face has a negative area.
    assert (areas[np.abs(areas) > 1e-9] < 0).all()
    count = texel_owners(head, triangles)
    assert count.max() == 1
    assert count.mean() >= 0.75


def test_all_skin_that_shows_has_texels(head: Head) -> None:
    shown = head.triangles[(head.opacity[head.triangles] > 0.02).all(1)]
    shown = shown[part(head, "skin")[shown[:, 0]]]
    assert np.abs(signed_areas(head.texture_coordinates, shown)).min() > 1e-8


def test_eyes_and_mouth_are_denser_in_the_atlas_than_the_cheeks(head: Head) -> None:
    skin = head.triangles[part(head, "skin")[head.triangles[:, 0]]]
    corners = head.vertices[skin]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    texels = np.abs(signed_areas(head.texture_coordinates, skin))
    density = np.sqrt(texels / (np.linalg.norm(normal, axis=1) / 2))
    middle = corners.mean(1)

    def around(point: Array, reach_mm: float) -> float:
        return float(np.median(density[np.linalg.norm(middle - point, axis=1) < reach_mm]))

    cheek = around(place(head, "or_l") + np.array([14, -28, -12]), 14)
    for point in (place(head, "ps_l"), place(head, "pi_l"), place(head, "ls"), place(head, "li")):
        assert 1.4 < around(point, 6) / cheek < 2.3


def test_texture_coordinates_lie_in_the_unit_square(head: Head) -> None:
    assert head.texture_coordinates.min() >= 0 and head.texture_coordinates.max() <= 1


def test_the_face_is_opaque_and_the_back_of_the_head_is_not(head: Head) -> None:
    skin = part(head, "skin")
    assert (head.opacity[~skin] == 1).all()
    for name in ("n", "prn", "sn", "ls", "li", "pg", "en_l", "ex_l", "ch_l", "sci_l", "al_r", "g"):
        assert head.opacity[head.landmarks[name]] == 1
    for name in ("v", "op", "eu_l", "po_l", "t_l"):
        assert head.opacity[head.landmarks[name]] < 0.1
    assert (head.opacity[skin & (head.vertices[:, 2] < 0)] == 0).all()


def test_all_landmarks_of_the_thesis_are_marked(head: Head) -> None:
    wanted = {*MIDLINE, *(f"{name}_{side}" for name in PAIRED for side in "lr")}
    assert wanted <= set(head.landmarks)
    for name in MIDLINE:
        assert abs(place(head, name)[0]) < 1e-3
    for name in PAIRED:
        left, right = place(head, f"{name}_l"), place(head, f"{name}_r")
        assert left[0] > 0
        np.testing.assert_allclose(left * [-1, 1, 1], right, atol=1e-3)


def test_landmarks_follow_one_another_down_the_profile(head: Head) -> None:
    names = ["v", "tr", "on", "g", "n", "prn", "sn", "ls", "sto_upper", "sto_lower", "li"]
    heights = [place(head, name)[1] for name in [*names, "sl", "pg", "gn"]]
    assert heights == sorted(heights, reverse=True)


def test_the_frankfurt_plane_is_horizontal_and_holds_the_origin(head: Head) -> None:
    assert abs(place(head, "t_l")[1] - place(head, "or_l")[1]) < 6
    np.testing.assert_allclose(place(head, "t_l")[1:], 0, atol=6)


# Means of young adults of both sexes after Farkas (1994), with three standard deviations and more.
@pytest.mark.parametrize(
    ("ends", "low_mm", "high_mm"),
    [
        (("en_l", "en_r"), 26, 40),
        (("ex_l", "ex_r"), 76, 102),
        (("en_l", "ex_l"), 25, 36),
        (("ps_l", "pi_l"), 7, 14),
        (("n", "sn"), 42, 62),
        (("al_l", "al_r"), 26, 42),
        (("ch_l", "ch_r"), 42, 62),
        (("sn", "gn"), 52, 82),
        (("n", "gn"), 98, 135),
        (("zy_l", "zy_r"), 118, 152),
        (("go_l", "go_r"), 80, 118),
        (("t_l", "t_r"), 125, 158),
        (("sto_upper", "sto_lower"), 0, 2),
    ],
)
def test_distances_are_human(
    head: Head, ends: tuple[str, str], low_mm: float, high_mm: float
) -> None:
    distance = np.linalg.norm(place(head, ends[0]) - place(head, ends[1]))
    assert low_mm < distance < high_mm


def test_network_points_come_in_mirrored_pairs(head: Head) -> None:
    ours, theirs = mirrored_rows(network_places(head, head.vertices))
    np.testing.assert_allclose(np.sort(ours[:, 1:], 0), np.sort(theirs[:, 1:], 0), atol=1e-6)
    np.testing.assert_allclose(np.sort(ours[:, 0]), np.sort(theirs[:, 0]), atol=0.3)


def test_network_weights_lie_inside_their_triangles_of_skin(head: Head) -> None:
    assert head.network_triangles.min() >= 0
    np.testing.assert_allclose(head.network_weights.sum(1), 1, atol=1e-5)
    assert head.network_weights.min() > -1e-5
    assert part(head, "skin")[head.triangles[head.network_triangles]].all()


def test_network_points_lie_where_anatomy_has_them(head: Head) -> None:
    at = network_places(head, head.vertices)
    for pair, name in ((OUTER_EYE, "ex"), (INNER_EYE, "en"), (MOUTH_CORNER, "ch")):
        for index, side in zip(pair, "lr", strict=True):
            assert np.linalg.norm(at[index] - place(head, f"{name}_{side}")) < 3
    assert np.linalg.norm(at[NOSE_TIP] - place(head, "prn")) < 5
    assert place(head, "gn")[1] < at[CHIN][1] < place(head, "sl")[1]
    assert place(head, "on")[1] < at[FOREHEAD][1] < place(head, "tr")[1]
    for up, down, brow in zip(UPPER_LID, LOWER_LID, BROW, strict=True):
        assert 7 < at[up][1] - at[down][1] < 13
        assert at[brow][1] > at[up][1] + 10


def test_inner_lip_points_part_with_the_jaw(head: Head) -> None:
    closed = network_places(head, head.vertices)
    opened = network_places(head, head.vertices + head.eau_up[EAU_INDEX["jaw_drop"]])
    gap_closed = closed[UPPER_INNER_LIP, 1] - closed[LOWER_INNER_LIP, 1]
    gap_opened = opened[UPPER_INNER_LIP, 1] - opened[LOWER_INNER_LIP, 1]
    assert -1 < gap_closed < 2
    assert gap_opened > 15


def test_lips_and_mouth_bag_stay_joined(head: Head) -> None:
    skin, bag = (np.flatnonzero(part(head, name)) for name in ("skin", "mouth"))
    apart = np.linalg.norm(head.vertices[bag, None] - head.vertices[None, skin], axis=-1)
    joined = np.flatnonzero(apart.min(1) < 1e-4)
    assert len(joined) >= 30
    for fields in (head.eau_up, head.eau_down, head.aau):
        difference = fields[:, bag[joined]] - fields[:, skin[apart.argmin(1)[joined]]]
        assert np.abs(difference).max() < 0.05


def test_stored_fields_are_those_of_the_model(head: Head) -> None:
    # If this fails: python -m assets.build_head --fields-only
    up, down = eau_fields(head.vertices, head.triangles, head.parts, head.landmarks)
    aau = aau_fields(head.vertices, head.parts, head.landmarks)
    for stored, computed in ((head.eau_up, up), (head.eau_down, down), (head.aau, aau)):
        np.testing.assert_allclose(stored, computed, atol=0.02)
