"""The order in which triangles of the head are drawn saves time and shows nowhere."""

import numpy as np
import pytest
from drawn_heads import drawn_picture

from decoder.rendering import renderer as render
from decoder.rendering.render_geometry import drawing_order
from decoder.rendering.renderer import Renderer
from shared_model.geometry import Camera, pose_from_euler
from shared_model.surround import head_with_surround

CAMERA = Camera(320, 240, 380.0)


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize("yaw_deg", [-50, 0, 25, 60])
def test_skin_drawn_by_its_opacity_gives_the_drawn_picture_all_triangles_in_order(
    yaw_deg: float, samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    head, pose = head_with_surround(), pose_from_euler(8, yaw_deg, 5, np.array([0.0, 0, 500]))
    rng = np.random.default_rng(2)
    atlas = rng.integers(0, 256, (64, 64, 3), np.uint8)
    ordered, ends = drawing_order(head)
    assert 0 < ends[0] < ends[1] < ends[2] < ordered.size == head.triangles.size
    with Renderer(CAMERA.width, CAMERA.height, head, samples) as renderer:
        renderer.set_texture(atlas)
        picture = drawn_picture(renderer, CAMERA, pose, head.vertices, expansion_px=0.7)
    monkeypatch.setattr(render, "drawing_order", lambda head: (head.triangles, (0, 0, 0)))
    with Renderer(CAMERA.width, CAMERA.height, head, samples) as renderer:
        renderer.set_texture(atlas)
        expected = drawn_picture(renderer, CAMERA, pose, head.vertices, expansion_px=0.7)
    np.testing.assert_array_equal(picture, expected)
