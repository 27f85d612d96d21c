"""Textures of frames: sampling, visibility, completion, and images within a size."""

import cv2
import numpy as np
import pytest
from shots import Shots

from encoder.appearance.texel_visibility import visible_texels
from encoder.appearance.texture import (
    atlas_size_for,
    default_colours,
    extract_texture,
    pixels_per_texel,
)
from encoder.picture_coding.image_budget import encode_background_webp_within, encode_webp_within
from runtime.image_ops import sample_bicubic
from shared_model.appearance import Atlas, atlas_of
from shared_model.geometry import camera_from_head, pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS
from shared_model.parameters import EAU_INDEX, EAUS


@pytest.fixture(scope="module")
def atlas(shots: Shots) -> Atlas:
    return atlas_of(shots.face.head, 96)


def test_samples_at_pixel_centres_are_the_pixels() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    places = np.array([(x, y) for y in range(30) for x in range(40)], np.float32)
    assert np.array_equal(sample_bicubic(picture, places), picture.reshape(-1, 3))
    assert sample_bicubic(picture[..., 0], places[:5]).shape == (5, 1)
    assert np.array_equal(sample_bicubic(picture, np.array([(-9.0, -9.0)])), picture[:1, 0])


def test_a_turned_head_hides_its_far_side(shots: Shots, atlas: Atlas) -> None:
    head, rest = shots.face.head, shots.face.neutral
    at = np.array([0.0, 0.0, 600.0])
    ahead = visible_texels(atlas, pose_from_euler(0, 0, 0, at), rest)
    left = visible_texels(atlas, pose_from_euler(0, 60, 0, at), rest)
    right = visible_texels(atlas, pose_from_euler(0, -60, 0, at), rest)
    x = atlas.points(rest)[:, 0]
    skin = head.parts[atlas.corners[:, 0]] == PARTS.index("skin")
    one, other = (side & (x > 40) & skin for side in (left, right))
    assert abs(int(one.sum()) - int(other.sum())) > 0.5 * max(one.sum(), other.sum())
    assert ahead[skin & (np.abs(x) < 20)].mean() > 0.6
    turned_away = visible_texels(atlas, pose_from_euler(0, 180, 0, at), rest)
    assert turned_away[skin & (np.abs(x) < 20)].mean() < 0.1


@pytest.mark.parametrize("depth_mm", [-300.0, 0.0, 40.0, 90.0, 130.0])
def test_a_camera_inside_the_head_sees_nothing_behind_it(
    shots: Shots, atlas: Atlas, depth_mm: float
) -> None:
    pose = pose_from_euler(5, 40, -8, np.array([30.0, -20.0, depth_mm]))
    visible = visible_texels(atlas, pose, shots.face.neutral)
    points = camera_from_head(pose, atlas.points(shots.face.neutral))
    assert not visible[points[:, 2] <= 0].any()


def test_an_open_mouth_shows_more_of_its_inside(shots: Shots, atlas: Atlas) -> None:
    head, pose = shots.face.head, shots.faces[0].pose
    inside = [PARTS.index(name) for name in ("teeth_upper", "teeth_lower", "tongue", "mouth")]
    within = np.isin(head.parts[atlas.corners[:, 0]], inside)
    wide = np.zeros(len(EAUS))
    wide[EAU_INDEX["jaw_drop"]] = 1
    closed, opened = (
        visible_texels(atlas, pose, shots.face.animate(eau))[within].mean()
        for eau in (0 * wide, wide)
    )
    assert closed < 0.35 and opened > 1.5 * closed


def test_a_texture_has_the_colours_of_the_picture(shots: Shots, atlas: Atlas) -> None:
    face = shots.faces[2]
    vertices, head = shots.face.animate(face.eau), shots.face.head
    texture = extract_texture(head, atlas, shots.camera, face.pose, vertices, shots.pictures[2])
    assert texture.shape == (96, 96, 3) and texture.dtype == np.uint8
    visible = visible_texels(atlas, face.pose, vertices)
    visible &= head.opacity[atlas.corners].min(1) > 0
    there = pixel_from_head(shots.camera, face.pose, atlas.points(vertices))
    expected = sample_bicubic(cv2.blur(shots.pictures[2], (3, 3)), there)[visible]
    found = texture[atlas.rows[visible], atlas.columns[visible]]
    assert np.median(np.abs(found - expected)) < 4


def test_teeth_seen_through_a_slit_get_default_colours(shots: Shots, atlas: Atlas) -> None:
    head, face, frame = shots.face.head, shots.faces[0], shots.pictures[0]
    vertices = shots.face.animate(np.zeros(len(EAUS)))
    teeth = head.parts[atlas.corners[:, 0]] == PARTS.index("teeth_upper")
    visible = visible_texels(atlas, face.pose, vertices) & teeth
    assert 0 < visible.sum() < 0.5 * teeth.sum()
    levels = []
    for light in (1.0, 0.6):
        dimmed = (light * frame).astype(np.uint8)
        texture = extract_texture(head, atlas, shots.camera, face.pose, vertices, dimmed)
        colours = texture[atlas.rows[teeth], atlas.columns[teeth]]
        np.testing.assert_array_equal(colours, colours[:1].repeat(len(colours), 0))
        levels.append(colours[0].astype(float))
    assert np.all(levels[1] < 0.85 * levels[0])


def test_a_narrow_fold_is_filled_from_its_neighbourhood(shots: Shots, atlas: Atlas) -> None:
    head, vertices = shots.face.head, shots.face.neutral
    pose = pose_from_euler(0, 4, 0, np.array([0.0, 0.0, 500.0]))
    tip = head.landmarks["prn"]
    frame = np.zeros((240, 320, 3), np.uint8)
    frame[:, int(pixel_from_head(shots.camera, pose, vertices)[tip, 0]) :] = 200
    texture = extract_texture(head, atlas, shots.camera, pose, vertices, frame)
    points = atlas.points(vertices)
    about_the_nose = np.linalg.norm(points - vertices[tip], axis=1) < 45
    about_the_nose &= head.parts[atlas.corners[:, 0]] == PARTS.index("skin")
    folded = about_the_nose & ~visible_texels(atlas, pose, vertices)
    found = texture[atlas.rows, atlas.columns, 0]
    # The subject's left is on the right of the picture.
    for side, level in ((points[:, 0] > 10, 200), (points[:, 0] < -10, 0)):
        assert (folded & side).sum() > 20
        assert np.all(found[folded & side] == level)


def test_hidden_parts_of_the_mouth_have_default_colours(shots: Shots, atlas: Atlas) -> None:
    colours = default_colours(shots.face.head, atlas)
    part = shots.face.head.parts[atlas.corners[:, 0]]
    assert np.isnan(colours[part == PARTS.index("skin")]).all()
    assert np.isfinite(colours[part == PARTS.index("teeth_upper")]).all()


def test_a_larger_face_gets_a_larger_atlas(shots: Shots) -> None:
    atlas, rest = atlas_of(shots.face.head, 64), shots.face.neutral
    sizes, spacings = [], []
    for depth_mm in (2500.0, 1000.0, 500.0):
        pose = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, depth_mm]))
        sizes.append(atlas_size_for(atlas, shots.camera, pose, rest, 320))
        spacings.append(pixels_per_texel(atlas, shots.camera, pose, rest))
    assert sizes == sorted(sizes) and sizes[0] < sizes[2] <= 320
    assert all(size % 16 == 0 for size in sizes)
    assert spacings[2] == pytest.approx(2 * spacings[1], rel=0.2)


def test_pictures_are_encoded_within_their_bytes(shots: Shots) -> None:
    picture = shots.pictures[0]
    small, large = encode_webp_within(picture, 1500), encode_webp_within(picture, 6000)
    assert len(small) <= 1500 < len(large) <= 6000
    for limit in (800, 4000):
        data = encode_background_webp_within(picture, limit)
        assert len(data) <= limit
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        # Scaled down, perhaps, but of the same shape.
        assert image.shape[1] / image.shape[0] == pytest.approx(4 / 3, rel=0.02)
