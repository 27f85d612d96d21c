"""What frames change of the layers is drawn, and drawn once."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from drawn_heads import drawn_picture
from heads import synthetic_head

from decoder.rendering import background_pass
from decoder.rendering.render_geometry import unseen_strips
from decoder.rendering.renderer import Renderer
from shared_model.arrays import Picture
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.light import Light
from shared_model.layers.scene_motion import moved_corners

CAMERA = Camera(320, 240, 380.0)
HEAD = synthetic_head(8, 10)
# The head is out of the picture.
AWAY = pose_from_euler(0, 0, 0, np.array([9000.0, 0, 700]))
OPACITY = np.zeros((240, 320), np.uint8)
OPACITY[80:160, 100:200] = 255


@contextmanager
def layers(still: Picture, behind: Picture) -> Iterator[Renderer]:
    """A renderer with a rectangle of one picture before another."""
    u, v = np.linspace(-0.5, 319.5, 21), np.linspace(-0.5, 239.5, 16)
    with Renderer(CAMERA.width, CAMERA.height, HEAD) as renderer:
        grid_px = np.stack(np.meshgrid(u, v), -1)
        renderer.set_background(np.dstack([still, OPACITY]), grid_px, behind)
        renderer.set_texture(np.zeros((16, 16, 3), dtype=np.uint8))
        yield renderer


def test_a_change_is_added_to_both_layers_and_to_the_next_frame_no_more() -> None:
    rng = np.random.default_rng(5)
    still, behind = rng.integers(40, 200, (2, 240, 320, 3), dtype=np.uint8)
    with layers(still, behind) as renderer:
        expected = np.where(OPACITY[..., None], still, behind).astype(int)
        change = np.full((6, 8, 3), 128, np.uint8)
        change += np.array([20, 0, 246], np.uint8)
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices, change=change)
        np.testing.assert_allclose(picture.astype(int), expected + np.array([20, 0, -10]), atol=1)
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices)
        np.testing.assert_allclose(picture.astype(int), expected, atol=1)


@pytest.mark.parametrize("light", [Light(1.5, -20.0), Light(0.4, 0.0)])
def test_light_is_on_both_layers_and_on_the_next_frame_no_more(light: Light) -> None:
    rng = np.random.default_rng(7)
    still, behind = rng.integers(0, 256, (2, 240, 320, 3), dtype=np.uint8)
    whole = np.where(OPACITY[..., None], still, behind).astype(float)
    with layers(still, behind) as renderer:
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices, light=light)
        expected = light.gain * (whole - 128) + 128 + light.offset
        np.testing.assert_allclose(picture.astype(float), np.clip(expected, 0, 255), atol=1)
        dark = np.clip(light.gain * (behind.astype(float) - 128) + 128 + light.offset, 0, 255)
        np.testing.assert_allclose(renderer.draw_scene().astype(float), dark, atol=1)
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices)
        np.testing.assert_allclose(picture.astype(float), whole, atol=1)


def test_the_scene_moves_behind_the_person_and_stands_still_again() -> None:
    rng = np.random.default_rng(6)
    still, behind = rng.integers(40, 200, (2, 240, 320, 3), dtype=np.uint8)
    # 5 pixels to the right, 3 up.
    corners = moved_corners(320, 240, np.array([5, -3]) / 3.2)
    moved = np.roll(behind, (-3, 5), (0, 1))
    with layers(still, behind) as renderer:
        for scene_corners, expected in ((corners, moved), (None, behind)):
            picture = drawn_picture(
                renderer, CAMERA, AWAY, HEAD.vertices, scene_corners=scene_corners
            )
            whole = np.where(OPACITY[..., None], still, expected).astype(int)
            np.testing.assert_allclose(
                picture[10:-10, 10:-10].astype(int), whole[10:-10, 10:-10], atol=1
            )


def test_what_the_camera_never_showed_is_the_scene_mirrored_and_ever_more_blurred() -> None:
    """Moved 60 pixels down: above its upper edge there are stripes, not streaks of one row."""
    behind = np.zeros((240, 320, 3), np.uint8)
    behind[:, ::2] = 200
    behind[:40:2] = 90
    corners = moved_corners(320, 240, np.array([0, 60]) / 3.2)
    with layers(np.zeros_like(behind), behind) as renderer:
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices, scene_corners=corners)
        seen = picture[70:80, :100].astype(int)
        np.testing.assert_allclose(seen, behind[10:20, :100].astype(int), atol=1)
        near, far = picture[56:59, 10:300].astype(float), picture[:10, 10:300].astype(float)
        # Rows differ where the edge stretched outwards would repeat one.
        assert np.abs(np.diff(near, axis=0)).mean() > 5
        assert far.std() < 0.4 * near.std()
        assert far.mean() == pytest.approx(behind[:60].mean(), abs=25)
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices)
        whole = np.where(OPACITY[..., None], 0, behind)
        np.testing.assert_allclose(picture.astype(int), whole.astype(int), atol=1)


@pytest.mark.parametrize(
    "coefficients", [(3, -2), (-20, 9), (0.5, 0, 12, 8), (0, 0, -6, 10), (2, 3, 0, -15), (120, 0)]
)
def test_only_the_strips_that_were_never_seen_are_mirrored(
    coefficients: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    behind = np.random.default_rng(8).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    corners = moved_corners(320, 240, np.array(coefficients))
    with layers(np.zeros_like(behind), behind) as renderer:
        picture = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices, scene_corners=corners)
        strips = unseen_strips(corners, (320, 240))
        # Of a scene that is shifted by a part of the frame most is seen.
        most = 0.1 if np.abs(coefficients).max() < 10 else 1.0
        assert sum(width * height for _, _, width, height in strips) <= most * 320 * 240
        everywhere = [(0, 0, 320, 240)]
        monkeypatch.setattr(background_pass, "unseen_strips", lambda *_: everywhere)
        whole = drawn_picture(renderer, CAMERA, AWAY, HEAD.vertices, scene_corners=corners)
        np.testing.assert_array_equal(picture, whole)


def test_a_scene_that_covers_the_frame_has_no_strips() -> None:
    assert unseen_strips(np.array([(0.1, 0.1), (0.9, 0), (0, 0.8), (1, 1)]), (320, 240)) == []
