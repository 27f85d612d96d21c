"""Heads as the decoder draws them."""

from typing import Any

from decoder.rendering.renderer import FrameState, Renderer
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.parameters import Pose


def drawn_picture(
    renderer: Renderer,
    camera: Camera,
    pose: Pose,
    vertices: Array,
    grid_px: Array | None = None,
    expansion_px: float = 0.0,
    **further: Any,
) -> Picture:
    """The picture of a frame, (h, w, 3) uint8 BGR.  further: fields of `FrameState`."""
    renderer.submit(camera, FrameState(pose, vertices, grid_px, **further), expansion_px)
    return renderer.read_back()
