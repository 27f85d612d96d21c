"""Draws the warped background picture: the pass before the head."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from decoder.rendering.gl_context import (
    as_float32,
    create_framebuffer,
    load_program,
    upload_picture,
)
from decoder.rendering.render_geometry import grid_triangles, opaque_triangles

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


class BackgroundPass:
    """The layers of the background in a GL context; draws nothing before `set`.

    size: of the frames, (width, height), pixels.
    samples: colour samples per pixel.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self._context, self._size, self._samples = context, size, samples
        self._moving: moderngl.Texture | None = None
        self._static: moderngl.Texture | None = None
        self._mesh: moderngl.VertexArray | None = None
        self._grid: moderngl.Buffer | None = None
        self._static_frame: moderngl.Framebuffer | None = None

    def set(self, moving: Picture, grid_px: Array, static: Picture | None) -> None:
        """See `Renderer.set_background`."""
        context = self._context
        self._moving = upload_picture(context, self._moving, "background", moving)
        coordinates = as_float32((grid_px.reshape(-1, 2) + 0.5) / self._size)
        program = load_program(context, "background")
        program["picture_px"] = self._size
        self._grid = context.buffer(as_float32(grid_px), dynamic=True)
        content = [
            (self._grid, "2f", "position_px"),
            (context.buffer(coordinates), "2f", "texture_coordinate"),
        ]
        triangles = grid_triangles(*grid_px.shape[:2])
        chosen = opaque_triangles(triangles, coordinates, moving)
        self._mesh = context.vertex_array(program, content, context.buffer(chosen))
        self._static_frame = None
        if static is not None:
            self._static = upload_picture(context, self._static, "static background", static)
            whole = context.vertex_array(program, content, context.buffer(triangles))
            self._static_frame = self._drawn(self._static, whole)
        context.gc()

    def draw(self, target: moderngl.Framebuffer, grid_px: Array | None) -> None:
        """Draw the layers into `target`.  grid_px: see `Renderer.submit`."""
        if self._mesh is None or self._grid is None or self._moving is None:
            return
        if grid_px is not None:
            self._grid.write(as_float32(grid_px))
        self._context.enable_only(moderngl.NOTHING)
        if self._static_frame is not None:
            self._context.copy_framebuffer(target, self._static_frame)
            self._context.enable_only(moderngl.BLEND)
        self._moving.use()
        self._mesh.render()

    def _drawn(self, texture: moderngl.Texture, mesh: moderngl.VertexArray) -> moderngl.Framebuffer:
        """A frame of the unwarped texture, to be copied into every frame."""
        frame = create_framebuffer(self._context, self._size, self._samples, with_depth=False)
        frame.use()
        frame.clear(alpha=1.0)
        self._context.enable_only(moderngl.NOTHING)
        texture.use()
        mesh.render()
        return frame
