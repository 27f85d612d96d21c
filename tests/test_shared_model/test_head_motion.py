"""The background mesh moves with the head, not far from it, and never folds."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from heads import synthetic_head

from decoder.scene.scene import mouth_shading
from shared_model.animate import Face, Identity
from shared_model.arrays import Array
from shared_model.geometry import Camera, euler_deg, pixel_from_head, pose_from_euler
from shared_model.layers.head_motion import (
    BackgroundMesh,
    make_background_mesh,
    smoothstep,
    warp,
)
from shared_model.mesh import Head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, Pose

Angles = tuple[float, float, float]

CAMERA = Camera(640, 480, 800.0)
REFERENCE = pose_from_euler(0, 0, 0, np.array([0.0, -20.0, 900.0]))
FACE_MM = 150.0


@pytest.fixture(scope="module")
def head() -> Head:
    return synthetic_head()


@pytest.fixture(scope="module")
def background_mesh(head: Head) -> BackgroundMesh:
    return make_background_mesh(CAMERA, REFERENCE, head, head.vertices)


def moved(dx: float = 0, dy: float = 0, dz: float = 0, angles: Angles = (0, 0, 0)) -> Pose:
    return pose_from_euler(*angles, REFERENCE.translation_mm + np.array([dx, dy, dz]))


def jacobian(grid: Array) -> Array:
    """(rows - 1, columns - 1, 4) signed areas at the corners of each cell."""
    across, down = np.diff(grid, axis=1), np.diff(grid, axis=0)

    def area(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    return np.stack(
        [
            area(across[i : len(across) - 1 + i], down[:, j : down.shape[1] - 1 + j])
            for i, j in product((0, 1), (0, 1))
        ],
        axis=-1,
    )


def test_nothing_moves_in_the_reference_pose(background_mesh: BackgroundMesh, head: Head) -> None:
    still = warp(background_mesh, REFERENCE, head.vertices)
    np.testing.assert_allclose(still, background_mesh.grid_px, atol=1e-9)


def test_mesh_covers_the_picture_to_its_edges(background_mesh: BackgroundMesh) -> None:
    np.testing.assert_array_equal(background_mesh.grid_px[0, 0], (-0.5, -0.5))
    np.testing.assert_array_equal(background_mesh.grid_px[-1, -1], (639.5, 479.5))
    assert max(background_mesh.grid_px.shape[:2]) <= 65


def test_hair_and_outline_move_as_far_as_the_head(
    background_mesh: BackgroundMesh, head: Head
) -> None:
    pose = moved(40, -15)
    motion = warp(background_mesh, pose, head.vertices) - background_mesh.grid_px
    at_head = motion[background_mesh.distance_px == 0]
    origin = np.zeros(3)
    expected = pixel_from_head(CAMERA, pose, origin) - pixel_from_head(CAMERA, REFERENCE, origin)
    # The skin is nearer than the head's origin and moves farther by its share of the depth.
    assert np.abs(at_head - expected).max() < 0.13 * np.linalg.norm(expected)


@pytest.mark.parametrize("angles", [(0, 20, 0), (12, 0, 0), (0, 0, 15), (8, -15, 10)])
def test_skin_in_the_picture_stays_under_the_drawn_skin(
    background_mesh: BackgroundMesh, head: Head, angles: Angles
) -> None:
    """On the opaque face the still moves with the mesh, not with a flat card."""
    pose = moved(15, 5, angles=angles)
    facing = (head.opacity == 1) & (head.vertices[:, 2] > 75) & (head.parts == 0)
    before = pixel_from_head(CAMERA, REFERENCE, head.vertices[facing])
    after = pixel_from_head(CAMERA, pose, head.vertices[facing])
    shown = _sample(background_mesh, warp(background_mesh, pose, head.vertices), before)
    # A flat card would be off by up to 30 px.
    assert np.linalg.norm(shown - after, axis=1).max() < 5.5


def test_chin_in_the_picture_moves_with_the_jaw(
    background_mesh: BackgroundMesh, head: Head
) -> None:
    face = Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))
    eau = np.zeros(len(EAUS))
    eau[EAU_INDEX["jaw_drop"]] = 1
    point = np.array([[0.0, -80, 65]])
    before = pixel_from_head(CAMERA, REFERENCE, point)
    shown = _sample(background_mesh, warp(background_mesh, REFERENCE, face.animate(eau)), before)
    drop_px = 20 * 80 / 110 * 800 / (900 - 65)
    assert shown[0, 1] - before[0, 1] == pytest.approx(drop_px, rel=0.35)


def test_far_points_do_not_move(background_mesh: BackgroundMesh, head: Head) -> None:
    motion = (
        warp(background_mesh, moved(20, 10, angles=(5, 8, 4)), head.vertices)
        - background_mesh.grid_px
    )
    far = background_mesh.distance_px > background_mesh.face_width_px
    assert far.sum() > 100 and np.abs(motion[far]).max() == 0


def test_neck_follows_translation_but_not_rotation(
    background_mesh: BackgroundMesh, head: Head
) -> None:
    """A hand below the chin, a roll of 15 degrees would swing the neck by 50 px."""
    chin = pixel_from_head(CAMERA, REFERENCE, np.array([0.0, -110, 0]))
    below = np.linalg.norm(
        background_mesh.grid_px - chin - (0, 0.62 * background_mesh.face_width_px), axis=-1
    )
    place = np.unravel_index(np.argmin(below), below.shape)
    rolled = (
        warp(background_mesh, moved(angles=(0, 0, 15)), head.vertices) - background_mesh.grid_px
    )[place]
    shifted = (warp(background_mesh, moved(20), head.vertices) - background_mesh.grid_px)[place]
    assert np.linalg.norm(rolled) < 3
    assert shifted[0] > 4


def test_nothing_comes_in_from_beyond_the_picture(head: Head) -> None:
    close = replace(REFERENCE, translation_mm=np.array([150.0, -120, 900]))
    background_mesh = make_background_mesh(CAMERA, close, head, head.vertices)
    for dx, dy in product((-60, 60), (-60, 60)):
        pose = replace(close, translation_mm=close.translation_mm + np.array([dx, dy, 0]))
        grid = warp(background_mesh, pose, head.vertices)
        assert grid[:, 0, 0].max() <= -0.5 and grid[:, -1, 0].min() >= 639.5
        assert grid[0, :, 1].max() <= -0.5 and grid[-1, :, 1].min() >= 479.5


@pytest.mark.parametrize("yaw", [-25, -12, 0, 12, 25])
@pytest.mark.parametrize("shift", [(0, 0), (0.7, 0), (-0.7, 0), (0, 0.5), (-0.5, -0.5)])
def test_mesh_never_folds_over(
    background_mesh: BackgroundMesh, head: Head, yaw: float, shift: tuple[float, float]
) -> None:
    for pitch, roll, dz in ((0, 0, 0), (12, 15, -120), (-12, -15, 150)):
        pose = moved(shift[0] * FACE_MM, shift[1] * FACE_MM, dz, (pitch, yaw, roll))
        assert euler_deg(pose)[1] == pytest.approx(yaw, abs=1e-6)
        assert jacobian(warp(background_mesh, pose, head.vertices)).min() > 0


def test_motion_falls_off_without_a_step(background_mesh: BackgroundMesh, head: Head) -> None:
    """Neighbouring cells are stretched alike: no edge shows in a plain wall."""
    grid = warp(background_mesh, moved(40), head.vertices)
    widths = np.diff(grid[..., 0], axis=1) / np.diff(background_mesh.grid_px[..., 0], axis=1)
    assert widths.min() > 0.3 and widths.max() < 1.8
    assert np.abs(np.diff(widths, axis=1)).max() < 0.35


def test_mouth_lightens_as_it_opens(head: Head) -> None:
    lights = []
    for gap_mm in (0.0, 3.0, 6.0, 12.0, 30.0):
        vertices = head.vertices.copy()
        lip = vertices[head.landmarks["sto_upper"]]
        vertices[head.landmarks["sto_lower"]] = lip - np.array([0, gap_mm, 0])
        lights.append(mouth_shading(head, vertices))
    assert lights == sorted(lights) and lights[0] < 0.5 and lights[-2:] == [1.0, 1.0]


def test_smoothstep_is_smooth() -> None:
    x = np.linspace(-0.5, 1.5, 2001)
    slope = np.gradient(smoothstep(x), x)
    assert slope.max() <= 1.5 + 1e-6 and slope.min() > -1e-9
    assert np.abs(np.diff(slope)).max() < 0.01


def _sample(background_mesh: BackgroundMesh, grid: Array, points: Array) -> Array:
    """Where `points` (k, 2) of the still are shown: bilinear between the mesh's points."""
    rows, columns = grid.shape[:2]
    cell = (points + 0.5) / (640, 480) * (columns - 1, rows - 1)
    j, i = np.clip(cell.astype(int), 0, (columns - 2, rows - 2)).T
    a, b = (cell - np.stack([j, i], 1)).T[..., None]
    top = grid[i, j] * (1 - a) + grid[i, j + 1] * a
    bottom = grid[i + 1, j] * (1 - a) + grid[i + 1, j + 1] * a
    return np.asarray(top * (1 - b) + bottom * b)
