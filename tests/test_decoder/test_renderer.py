"""The renderer draws where the geometry says, in the colours it was given, over its background."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from drawn_heads import drawn_picture
from heads import synthetic_head

from decoder.rendering.render_geometry import part_colours, teeth_falloff
from decoder.rendering.renderer import Renderer
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError
from shared_model.geometry import Camera, camera_from_head, pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS, Head, generic_head, inside_mouth
from shared_model.parameters import Pose

CAMERA = Camera(320, 240, 380.0)
AHEAD = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 700.0]))
# Turned, near the corner, in a picture with odd sides.
ASKEW = pose_from_euler(-12, 21, 9, np.array([-95.0, 60.0, 620.0]))
ODD_CAMERA = Camera(321, 243, 377.3)


def quads_head(corners: Array, texture: Array, opacity: float = 1.0) -> Head:
    """A head of separate quadrilaterals; corners (k, 4, 3) counter-clockwise from outside, mm."""
    first = np.arange(len(corners))[:, None] * 4
    triangles = np.concatenate([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    n = corners.shape[0] * 4
    return replace(
        synthetic_head(4, 6),
        vertices=corners.reshape(-1, 3),
        triangles=triangles.astype(np.int32),
        texture_coordinates=texture.reshape(-1, 2),
        parts=np.zeros(n, dtype=np.uint8),
        opacity=np.full(n, opacity),
    )


def square(centre: Array, half_mm: float) -> Array:
    offsets = np.array([(-1, 1, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 0)], dtype=np.float64)
    return centre + half_mm * offsets


def centroid(picture: Picture) -> Array:
    """(2,) intensity-weighted mean position, pixels."""
    weight = picture[..., 0].astype(np.float64)
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
    return np.asarray(np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum())


@pytest.fixture(scope="module")
def head() -> Head:
    return synthetic_head()


@pytest.fixture
def renderer(head: Head) -> Iterator[Renderer]:
    with Renderer(CAMERA.width, CAMERA.height, head) as drawn:
        yield drawn


@pytest.mark.parametrize(("camera", "pose"), [(CAMERA, AHEAD), (ODD_CAMERA, ASKEW)])
def test_projection_agrees_with_the_geometry_to_a_hundredth_of_a_pixel(
    camera: Camera, pose: Pose
) -> None:
    """Sixteen samples a pixel would blur the edge; a wide dot with a soft texture tells more."""
    n = 64
    v, u = np.mgrid[:n, :n] + 0.5
    bump = np.exp(-((u - n / 2) ** 2 + (v - n / 2) ** 2) / (2 * 9.0**2)) * 255
    atlas = np.repeat(np.rint(bump)[..., None], 3, axis=2).astype(np.uint8)
    corners = np.array([(0, 0), (0, 1), (1, 1), (1, 0)], dtype=np.float64)
    for centre in ([0.0, 0, 60], [-40, 60, 20], [45, -70, 90]):
        place = np.array(centre)
        quad = quads_head(square(place, 24.0)[None], corners[None])
        with Renderer(camera.width, camera.height, quad) as renderer:
            renderer.set_texture(atlas)
            picture = drawn_picture(renderer, camera, pose, quad.vertices)
        expected = _projected_centroid(camera, pose, place)
        assert np.abs(centroid(picture) - expected).max() < 0.01


def _projected_centroid(camera: Camera, pose: Pose, place: Array) -> Array:
    """Where the projected bump's centroid lies: perspective shifts it a little off its centre."""
    span = np.linspace(-23.5, 23.5, 189)
    x, y = np.meshgrid(span, span)
    points = place + np.stack([x, y, np.zeros_like(x)], -1)
    brightness = np.exp(-(x**2 + y**2) / (2 * (9.0 * 48 / 64) ** 2))
    pixels = pixel_from_head(camera, pose, points)
    # Equal areas of the square are not equal areas of the picture: weigh by the Jacobian.
    depth = camera_from_head(pose, points)[..., 2]
    weight = brightness / depth**3
    return np.asarray((pixels * weight[..., None]).sum((0, 1)) / weight.sum())


def test_vertex_edges_fall_between_the_right_pixels() -> None:
    """A square whose edges lie half-way between pixel centres covers exactly those pixels."""
    mm = CAMERA.focal_px / 700
    centre = CAMERA.centre
    low, high = np.array([99.5, 79.5]), np.array([139.5, 109.5])
    (x0, y0), (x1, y1) = (low - centre) / mm, (high - centre) / mm
    corners = np.array([[x0, -y0, 0], [x0, -y1, 0], [x1, -y1, 0], [x1, -y0, 0]])
    quad = quads_head(corners[None], np.full((1, 4, 2), 0.5))
    with Renderer(CAMERA.width, CAMERA.height, quad) as renderer:
        renderer.set_texture(np.full((8, 8, 3), 255, dtype=np.uint8))
        picture = drawn_picture(renderer, CAMERA, AHEAD, quad.vertices)
    expected = np.zeros((240, 320, 3), dtype=np.uint8)
    expected[80:110, 100:140] = 255
    np.testing.assert_array_equal(picture, expected)


def test_atlas_pixel_centres_are_where_the_docstring_says() -> None:
    """An atlas drawn at its own size comes back pixel for pixel, blue stays blue, top stays top."""
    rng = np.random.default_rng(3)
    atlas = rng.integers(0, 256, (32, 48, 3), dtype=np.uint8)
    mm = CAMERA.focal_px / 700
    (x0, y0), (x1, y1) = ((np.array(p) - 0.5 - CAMERA.centre) / mm for p in ((100, 80), (148, 112)))
    corners = np.array([[x0, -y0, 0], [x0, -y1, 0], [x1, -y1, 0], [x1, -y0, 0]])
    texture = np.array([(0, 0), (0, 1), (1, 1), (1, 0)], dtype=np.float64)
    quad = quads_head(corners[None], texture[None])
    with Renderer(CAMERA.width, CAMERA.height, quad) as renderer:
        renderer.set_texture(atlas)
        picture = drawn_picture(renderer, CAMERA, AHEAD, quad.vertices)
    np.testing.assert_allclose(picture[80:112, 100:148].astype(int), atlas, atol=1)


def test_a_far_face_is_averaged_from_its_atlas_and_a_near_one_is_not() -> None:
    rng = np.random.default_rng(5)
    atlas = rng.choice(np.array([0, 255], dtype=np.uint8), (256, 256, 1)).repeat(3, axis=2)
    texture = np.array([(0, 0), (0, 1), (1, 1), (1, 0)], dtype=np.float64)
    quad = quads_head(square(np.zeros(3), 100.0)[None], texture[None])
    contrasts = []
    with Renderer(CAMERA.width, CAMERA.height, quad) as renderer:
        renderer.set_texture(atlas)
        for depth_mm in (4000.0, 700.0):
            pose = pose_from_euler(0, 0, 0, np.array([0.0, 0, depth_mm]))
            picture = drawn_picture(renderer, CAMERA, pose, quad.vertices)
            inside = picture[112:128, 152:168].astype(np.float64)
            contrasts.append(inside.std())
            assert abs(inside.mean() - atlas.mean()) < 12
    assert contrasts[0] < 30 and contrasts[1] > 75


def test_an_unwarped_background_is_shown_exactly(renderer: Renderer, head: Head) -> None:
    still = np.random.default_rng(1).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    u, v = np.linspace(-0.5, 319.5, 21), np.linspace(-0.5, 239.5, 16)
    renderer.set_background(still, np.stack(np.meshgrid(u, v), -1))
    renderer.set_texture(np.zeros((16, 16, 3), dtype=np.uint8))
    away = pose_from_euler(0, 0, 0, np.array([9000.0, 0, 700]))
    picture = drawn_picture(renderer, CAMERA, away, head.vertices)
    np.testing.assert_allclose(picture.astype(int), still, atol=1)


def test_a_warped_mesh_moves_the_background(renderer: Renderer, head: Head) -> None:
    rng = np.random.default_rng(2)
    still = rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)
    u, v = np.linspace(-0.5, 319.5, 21), np.linspace(-0.5, 239.5, 16)
    rest = np.stack(np.meshgrid(u, v), -1)
    renderer.set_background(still, rest)
    renderer.set_texture(np.zeros((16, 16, 3), dtype=np.uint8))
    away = pose_from_euler(0, 0, 0, np.array([9000.0, 0, 700]))
    picture = drawn_picture(renderer, CAMERA, away, head.vertices, rest + np.array((7, -4)))
    np.testing.assert_allclose(picture[:236, 7:].astype(int), still[4:, :-7], atol=1)


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize(
    "shown",
    [np.s_[80:160, 100:200], np.s_[95:97, 111:113], np.s_[100, 120], np.s_[0:0, 0:0], np.s_[:, :]],
)
def test_the_static_layer_shows_where_the_moving_one_is_transparent(
    head: Head, shown: tuple[slice | int, slice | int], samples: int
) -> None:
    rng = np.random.default_rng(4)
    still, behind = rng.integers(0, 256, (2, 240, 320, 3), dtype=np.uint8)
    opacity = np.zeros((240, 320), np.uint8)
    opacity[shown] = 255
    u, v = np.linspace(-0.5, 319.5, 21), np.linspace(-0.5, 239.5, 16)
    rest = np.stack(np.meshgrid(u, v), -1)
    away = pose_from_euler(0, 0, 0, np.array([9000.0, 0, 700]))
    expected = np.where(opacity[..., None], still, behind)
    with Renderer(CAMERA.width, CAMERA.height, head, samples) as renderer:
        renderer.set_background(np.dstack([still, opacity]), rest, behind)
        renderer.set_texture(np.zeros((16, 16, 3), dtype=np.uint8))
        picture = drawn_picture(renderer, CAMERA, away, head.vertices)
        np.testing.assert_allclose(picture.astype(int), expected, atol=1)
        picture = drawn_picture(renderer, CAMERA, away, head.vertices, rest + np.array((7, -4)))
        moved = behind.copy()
        moved[:236, 7:] = np.where(opacity[4:, :-7, None], still[4:, :-7], behind[:236, 7:])
        within = picture[:236, 7:].astype(int)
        np.testing.assert_allclose(within, moved[:236, 7:], atol=1)
        np.testing.assert_allclose(renderer.draw_scene().astype(int), behind, atol=1)
        renderer.set_background(still, rest)
        picture = drawn_picture(renderer, CAMERA, away, head.vertices)
        np.testing.assert_allclose(picture.astype(int), still, atol=1)


def test_opacity_blends_the_head_over_the_background() -> None:
    texture = np.full((1, 4, 2), 0.5)
    quad = quads_head(square(np.zeros(3), 30.0)[None], texture, opacity=0.25)
    with Renderer(CAMERA.width, CAMERA.height, quad) as renderer:
        renderer.set_texture(np.full((8, 8, 3), (200, 100, 40), dtype=np.uint8))
        u, v = np.linspace(-0.5, 319.5, 3), np.linspace(-0.5, 239.5, 3)
        still = np.full((240, 320, 3), (40, 60, 80), dtype=np.uint8)
        renderer.set_background(still, np.stack(np.meshgrid(u, v), -1))
        picture = drawn_picture(renderer, CAMERA, AHEAD, quad.vertices)
    np.testing.assert_allclose(picture[120, 160].astype(int), (80, 70, 70), atol=1)
    np.testing.assert_array_equal(picture[5, 5], (40, 60, 80))


def test_skin_hides_the_inside_of_the_head_even_where_it_is_transparent() -> None:
    far, near = square(np.array([0.0, 0, 0]), 30.0), square(np.array([0.0, 0, 40]), 10.0)
    texture = np.stack([np.full((4, 2), 0.25), np.full((4, 2), 0.75)])
    atlas = np.zeros((2, 2, 3), dtype=np.uint8)
    atlas[0, 0], atlas[1, 1] = 100, 200
    for opacity, expected in ((1.0, 200), (0.0, 0)):
        quad = quads_head(np.stack([near, far]), texture[::-1])
        parts = np.repeat([PARTS.index(part) for part in ("skin", "mouth")], 4).astype(np.uint8)
        shown = replace(quad, opacity=np.repeat([opacity, 1.0], 4), parts=parts)
        with Renderer(CAMERA.width, CAMERA.height, shown) as renderer:
            renderer.set_texture(atlas)
            picture = drawn_picture(renderer, CAMERA, AHEAD, shown.vertices)
        assert abs(int(picture[120, 160, 0]) - expected) <= 1


def test_only_the_inside_of_the_mouth_is_darkened() -> None:
    corners = np.stack([square(np.array([x, 0.0, 0]), 20.0) for x in (-30, 30)])
    quads = quads_head(corners, np.full((2, 4, 2), 0.5))
    parts = np.repeat([PARTS.index("skin"), PARTS.index("teeth_upper")], 4).astype(np.uint8)
    mouth = replace(quads, parts=parts)
    with Renderer(CAMERA.width, CAMERA.height, mouth) as renderer:
        renderer.set_texture(np.full((8, 8, 3), 200, dtype=np.uint8))
        for light, expected in ((0.5, 100), (None, 200)):
            picture = drawn_picture(renderer, CAMERA, AHEAD, mouth.vertices, mouth_shading=light)
            assert abs(int(picture[120, 143, 0]) - 200) <= 1
            assert abs(int(picture[120, 176, 0]) - expected) <= 1


def test_the_same_frame_is_drawn_the_same_twice(renderer: Renderer, head: Head) -> None:
    atlas = np.random.default_rng(4).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    renderer.set_texture(atlas)
    first = drawn_picture(renderer, CAMERA, AHEAD, head.vertices)
    other = drawn_picture(renderer, CAMERA, ASKEW, head.vertices)
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(drawn_picture(renderer, CAMERA, AHEAD, head.vertices), first)


@pytest.mark.parametrize("pitch_deg", [-20, 0, 25])
def test_the_inside_of_a_closed_mouth_shows_nowhere(pitch_deg: float) -> None:
    head, pose = generic_head(), pose_from_euler(pitch_deg, 10, 0, np.array([0.0, 0, 500]))
    atlas = np.full((128, 128, 3), 200, np.uint8)
    within = inside_mouth(head)
    top = int(head.texture_coordinates[within, 1].min() * 128)
    assert head.texture_coordinates[~within, 1].max() * 128 < top
    atlas[top:] = 0, 0, 255
    with Renderer(CAMERA.width, CAMERA.height, head) as renderer:
        renderer.set_texture(atlas)
        picture = drawn_picture(renderer, CAMERA, pose, head.vertices, expansion_px=0.7).astype(int)
    shown = picture[..., 2] > picture[..., 0] + 60
    assert (picture > 150).any() and shown.sum() <= 12


def test_two_renderers_do_not_disturb_each_other(renderer: Renderer, head: Head) -> None:
    renderer.set_texture(np.full((8, 8, 3), 255, dtype=np.uint8))
    first = drawn_picture(renderer, CAMERA, AHEAD, head.vertices)
    with Renderer(64, 48, head) as other:
        other.set_texture(np.full((8, 8, 3), 9, dtype=np.uint8))
        drawn_picture(other, Camera(64, 48, 70.0), AHEAD, head.vertices)
        np.testing.assert_array_equal(drawn_picture(renderer, CAMERA, AHEAD, head.vertices), first)
    np.testing.assert_array_equal(drawn_picture(renderer, CAMERA, AHEAD, head.vertices), first)


def test_shaded_head_shows_its_silhouette_and_white_eyes(renderer: Renderer, head: Head) -> None:
    picture = renderer.draw_shaded(CAMERA, AHEAD, head.vertices)
    pixels = pixel_from_head(CAMERA, AHEAD, head.vertices)
    rows = np.flatnonzero((picture != picture[0, 0]).any(axis=(1, 2)))
    assert abs(rows[0] - pixels[:, 1].min()) < 2 and abs(rows[-1] - pixels[:, 1].max()) < 2
    u, v = np.rint(pixel_from_head(CAMERA, AHEAD, np.array([31.0, 20, 90]))).astype(int)
    assert picture[v, u].min() > 150 and u > 160
    assert part_colours(head).shape == (len(head.vertices), 3)


def test_misuse_is_named(renderer: Renderer, head: Head) -> None:
    with pytest.raises(ValueError, match="no texture"):
        drawn_picture(renderer, CAMERA, AHEAD, head.vertices)
    with pytest.raises(ValueError, match="atlas is float64"):
        renderer.set_texture(np.zeros((8, 8, 3)))  # type: ignore[arg-type]
    renderer.set_texture(np.zeros((8, 8, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match="vertices have shape"):
        drawn_picture(renderer, CAMERA, AHEAD, head.vertices[:5])
    with pytest.raises(ValueError, match="camera is 9x9"):
        drawn_picture(renderer, Camera(9, 9, 9.0), AHEAD, head.vertices)


def test_missing_egl_tells_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise Exception("(eglInitialize) cannot initialise")

    monkeypatch.setattr("moderngl.create_context", refuse)
    with pytest.raises(UserError, match="install libegl1 libgl1"):
        Renderer(8, 8, synthetic_head(4, 6))


def test_molars_are_dark_and_front_teeth_are_not() -> None:
    head = generic_head()
    light, depth_mm = teeth_falloff(head), head.vertices[:, 2]
    teeth = np.isin(head.parts, [PARTS.index(part) for part in ("teeth_upper", "teeth_lower")])
    assert light[teeth & (depth_mm > depth_mm[teeth].max() - 10)].min() == 1
    assert light[teeth & (depth_mm < depth_mm[teeth].max() - 40)].max() < 0.1
    assert (light[~teeth] == 1).all()
