"""Muscles pull where anatomy says, linearly, and the same on both sides."""

import numpy as np
import pytest

from shared_model.anatomy import muscle_table as table
from shared_model.anatomy.expressions import eau_fields
from shared_model.anatomy.jaw_and_eyelids import eye, gaze_field
from shared_model.anatomy.mouth import mouth_line
from shared_model.anatomy.muscles import (
    Anchor,
    LinearMuscle,
    Muscle,
    SphincterMuscle,
    anchor_position,
    falloff,
)
from shared_model.arrays import Array, Picture, VertexIndices
from shared_model.mesh import PARTS, generic_head
from shared_model.parameters import EAU_INDEX, EAUS

Fields = tuple[Array, Array]

HEAD = generic_head()
POINTS = {name: HEAD.vertices[index] for name, index in HEAD.landmarks.items()}
LINE = {"root_l": np.zeros(3), "skin_l": np.array([40.0, 0, 0])}


@pytest.fixture(scope="module")
def fields() -> Fields:
    return eau_fields(HEAD.vertices, HEAD.triangles, HEAD.parts, HEAD.landmarks)


def test_fall_goes_from_one_to_zero_without_a_step() -> None:
    x = np.linspace(-5, 15, 200)
    y = falloff(x, 0, 10)
    assert y[0] == 1 and y[-1] == 0 and np.all(np.diff(y) <= 0) and np.abs(np.diff(y)).max() < 0.02


def test_a_linear_muscle_pulls_its_insertion_fully_towards_its_attachment() -> None:
    muscle = LinearMuscle("m", Anchor("root"), Anchor("skin"), 40, 40, 60, 8.0)
    field = muscle.displacement(np.array([[40.0, 0, 0], [0, 40.0, 0], [70.0, 0, 0]]), LINE, "l")
    np.testing.assert_allclose(field[0], [-8, 0, 0], atol=1e-9)
    np.testing.assert_allclose(field[1:], 0, atol=1e-9)


def test_a_sphincter_draws_towards_its_centre_and_forward() -> None:
    muscle = SphincterMuscle("s", Anchor("root"), (40, 40, 40), (0.5, 0.5), 3.0)
    field = muscle.displacement(np.array([[10.0, 0, 0], [0, 0, 0]]), LINE, "l")
    assert -5 < field[0, 0] < -3 and field[0, 1] == 0
    np.testing.assert_allclose(field[1], [0, 0, 3])


@pytest.mark.parametrize("muscle", table.MUSCLES, ids=lambda m: m.name)
def test_every_muscle_pulls_its_own_side_like_its_twin(
    muscle: Muscle,
) -> None:
    """Each is anchored on the head."""
    left = muscle.displacement(HEAD.vertices, POINTS, "l")
    mirrored = muscle.displacement(HEAD.vertices * [-1, 1, 1], POINTS, "r") * [-1, 1, 1]
    np.testing.assert_allclose(left, mirrored, atol=1e-4)
    assert 0.5 < np.linalg.norm(left[HEAD.parts == 0], axis=1).max() < 20


def test_a_missing_landmark_is_named() -> None:
    with pytest.raises(ValueError, match="'nowhere'"):
        anchor_position(Anchor("nowhere"), POINTS, "l")


def test_fields_in_the_head_are_those_of_the_muscles(fields: Fields) -> None:
    for stored, field in zip((HEAD.eau_up, HEAD.eau_down), fields, strict=True):
        np.testing.assert_allclose(stored, field, atol=0.02)


def test_another_mesh_with_the_same_landmarks_is_animated_by_the_same_muscles(
    fields: Fields,
) -> None:
    """Each triangle cut into four, on a wider and longer head: the old vertices move alike."""
    shape = HEAD.vertices + 0.5 * HEAD.aau[:4].sum(0)
    vertices, triangles, parts = cut_into_four(shape, HEAD.triangles, HEAD.parts)
    up, down = eau_fields(vertices, triangles, parts, HEAD.landmarks)
    for eau, index in EAU_INDEX.items():
        for found, expected in ((up[index], fields[0][index]), (down[index], fields[1][index])):
            a, b = found[: len(shape)].ravel(), expected.ravel()
            assert (not a.any() and not b.any()) or a @ b > 0.95 * np.sqrt((a @ a) * (b @ b)), eau


def cut_into_four(
    vertices: Array, triangles: VertexIndices, parts: Picture
) -> tuple[Array, VertexIndices, Picture]:
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middle = len(vertices) + inverse.reshape(-1, 3)
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return (
        np.concatenate([vertices, vertices[unique].mean(1)]),
        np.concatenate([np.stack(corners, 1) for corners in quarters]).astype(np.int32),
        np.append(parts, parts[unique[:, 0]]),
    )


def test_zygomatic_draws_the_corner_of_the_mouth_up_out_and_back(fields: Fields) -> None:
    pull = fields[0][EAU_INDEX["mouth_corners"], HEAD.landmarks["ch_l"]]
    assert pull[0] > 2 and pull[1] > 5 and pull[2] < 0


def test_pucker_narrows_the_mouth_and_brings_the_lips_forward(fields: Fields) -> None:
    pucker = fields[1][EAU_INDEX["lip_stretch"]]
    assert pucker[HEAD.landmarks["ch_l"], 0] < -4 < 4 < pucker[HEAD.landmarks["ch_r"], 0]
    assert pucker[HEAD.landmarks["sto"], 2] > 5


def test_jaw_drop_parts_the_lips_but_not_their_corners(fields: Fields) -> None:
    jaw = fields[0][EAU_INDEX["jaw_drop"]]
    marks = HEAD.landmarks
    assert jaw[marks["sto_lower"], 1] < -18 or jaw[marks["li"], 1] < -18
    assert abs(jaw[marks["ls"], 1]) < 1.5
    corner = np.linalg.norm(HEAD.vertices - HEAD.vertices[marks["ch_l"]], axis=1) < 3
    corner &= HEAD.parts == PARTS.index("skin")
    assert np.ptp(jaw[corner, 1]) < 4


def test_lower_teeth_follow_the_jaw_rigidly_and_upper_teeth_stay(fields: Fields) -> None:
    jaw = fields[0][EAU_INDEX["jaw_drop"]]
    lower, upper = (HEAD.parts == PARTS.index(f"teeth_{name}") for name in ("lower", "upper"))
    assert np.all(jaw[upper] == 0) and jaw[lower, 1].min() < -15
    before = np.linalg.norm(HEAD.vertices[lower][0] - HEAD.vertices[lower], axis=1)
    moved = HEAD.vertices[lower] + jaw[lower]
    np.testing.assert_allclose(np.linalg.norm(moved[0] - moved, axis=1), before, atol=0.1)


def test_the_surface_tells_the_lips_apart() -> None:
    line = mouth_line(HEAD.vertices, HEAD.triangles, POINTS)
    marks = HEAD.landmarks
    assert line.lower[marks["ls"]] == 0 and line.lower[marks["li"]] == 1
    assert line.lower[marks["sto_upper"]] == 0 and line.lower[marks["sto_lower"]] <= 1


@pytest.mark.parametrize("closed", [0.25, 0.5, 0.75, 1.0])
def test_the_upper_lid_slides_over_the_eyeball_without_cutting_into_it(
    fields: Fields, closed: float
) -> None:
    lid = fields[0][EAU_INDEX["lid_left"]]
    ball = eye(HEAD.vertices, HEAD.parts, "l")
    skin = HEAD.parts == PARTS.index("skin")
    outside = np.linalg.norm(HEAD.vertices - ball.centre, axis=1) > ball.radius + 0.3
    moving = skin & outside & (np.linalg.norm(lid, axis=1) > 0.5)
    away = np.linalg.norm(HEAD.vertices[moving] + closed * lid[moving] - ball.centre, axis=1)
    assert away.min() > ball.radius


def test_a_closed_lid_meets_the_lower_one(fields: Fields) -> None:
    lid = fields[0][EAU_INDEX["lid_left"]]
    marks = HEAD.landmarks
    upper = HEAD.vertices[marks["ps_l"]] + lid[marks["ps_l"]]
    lower = HEAD.vertices[marks["pi_l"]] + lid[marks["pi_l"]]
    assert -1.5 < upper[1] - lower[1] < 0.8


def test_gaze_turns_the_pupils_by_thirty_degrees_and_keeps_the_balls_round() -> None:
    field = gaze_field(HEAD.vertices, HEAD.parts, 1, 0)
    for side, name in (("l", "eye_left"), ("r", "eye_right")):
        ball = eye(HEAD.vertices, HEAD.parts, side)
        moved = HEAD.vertices + field
        part = HEAD.parts == PARTS.index(name)
        pupil = np.flatnonzero(part)[HEAD.vertices[part, 2].argmax()]
        turn = moved[pupil] - ball.centre
        assert np.degrees(np.arctan2(turn[0], turn[2])) == pytest.approx(30, abs=0.5)
        reach = np.linalg.norm(moved[part] - ball.centre, axis=1)
        np.testing.assert_allclose(reach, ball.radius, atol=0.05)


def test_one_sided_actuators_have_no_negative_field(fields: Fields) -> None:
    for eau in EAUS:
        assert (np.abs(fields[1][EAU_INDEX[eau.name]]).max() == 0) == (eau.low == 0)
