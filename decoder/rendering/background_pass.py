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
from decoder.rendering.render_geometry import grid_triangles, shown_triangles
from shared_model.layers.light import SAME_LIGHT, Light
from shared_model.layers.scene_motion import PICTURE_CORNERS

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
        # By whether a change or light is added; without, fragments take less time.
        self._programs = {
            False: load_program(context, "background"),
            True: load_program(context, "background", ("ADDS",)),
        }
        self._meshes: dict[bool, moderngl.VertexArray] = {}
        self._solid = 0  # indices of the mesh, the first ones, of triangles without transparency
        self._grid: moderngl.Buffer | None = None
        self._static_frame: moderngl.Framebuffer | None = None
        self._change: moderngl.Texture | None = None
        self._scenes: dict[bool, moderngl.VertexArray] = {}
        self._scene_corners: moderngl.Buffer | None = None
        # Whether the scene was drawn last with a change or light, and from where.
        self._last: tuple[bool, Array | None] = False, None

    def set(self, moving: Picture, grid_px: Array, static: Picture | None) -> None:
        """See `Renderer.set_background`."""
        context = self._context
        self._moving = upload_picture(context, self._moving, "background", moving)
        coordinates = as_float32((grid_px.reshape(-1, 2) + 0.5) / self._size)
        for program in self._programs.values():
            program["picture_px"] = self._size
        self._grid = context.buffer(as_float32(grid_px), dynamic=True)
        content = [
            (self._grid, "2f", "position_px"),
            (context.buffer(coordinates), "2f", "texture_coordinate"),
        ]
        triangles = grid_triangles(*grid_px.shape[:2])
        solid, blended = shown_triangles(triangles, coordinates, moving)
        self._solid = solid.size
        shown = context.buffer(np.concatenate([solid, blended]))
        self._meshes = {
            adds: context.vertex_array(program, content, shown)
            for adds, program in self._programs.items()
        }
        self._static_frame, self._scenes = None, {}
        if static is not None:
            self._static = upload_picture(context, self._static, "static background", static)
            whole = context.vertex_array(self._programs[False], content, context.buffer(triangles))
            self._static_frame = self._drawn(self._static, whole)
            self._scenes = self._whole_picture()
        context.gc()

    def draw(
        self,
        target: moderngl.Framebuffer,
        grid_px: Array | None,
        change: Picture | None = None,
        scene_corners: Array | None = None,
        light: Light | None = None,
    ) -> None:
        """Draw the layers into `target`.  For the others see `Renderer.submit`."""
        if not self._meshes or self._grid is None or self._moving is None:
            return
        if grid_px is not None:
            self._grid.write(as_float32(grid_px))
        adds = change is not None or light not in (None, SAME_LIGHT)
        if adds:
            self._write_added(change, light or SAME_LIGHT)
        self._context.enable_only(moderngl.NOTHING)
        self._last = adds, scene_corners
        if self._static_frame is not None:
            self._draw_scene(target, *self._last)
        self._moving.use()
        mesh = self._meshes[adds]
        if self._solid:
            mesh.render(vertices=self._solid)
        if self._static_frame is not None:
            self._context.enable_only(moderngl.BLEND)
        if self._solid < mesh.vertices:
            mesh.render(first=self._solid, vertices=mesh.vertices - self._solid)

    def _write_added(self, change: Picture | None, light: Light) -> None:
        program, (gain, offset) = self._programs[True], light
        program["picture"], program["change"], program["changes"] = 0, 1, change is not None
        program["light"] = gain - 1, offset / 255
        if change is not None:
            self._change = upload_picture(self._context, self._change, "change", change)
            self._change.use(1)

    def draw_scene(self, target: moderngl.Framebuffer) -> None:
        """Draw the layer that does not move with the person, as `draw` has drawn it last."""
        self._context.enable_only(moderngl.NOTHING)
        if self._static_frame is not None:
            self._draw_scene(target, *self._last)

    def _draw_scene(self, target: moderngl.Framebuffer, adds: bool, corners: Array | None) -> None:
        """Copy the scene as it was drawn once, or draw it again with its change or moved."""
        assert self._static_frame is not None
        if not self._scenes or self._static is None or self._scene_corners is None:
            return
        if not adds and corners is None:
            self._context.copy_framebuffer(target, self._static_frame)
            return
        self._scene_corners.write(as_float32(PICTURE_CORNERS if corners is None else corners))
        self._static.use()
        self._scenes[adds].render(moderngl.TRIANGLE_STRIP)

    def _whole_picture(self) -> dict[bool, moderngl.VertexArray]:
        """Two triangles over the whole picture, for each program."""
        context, corners = self._context, PICTURE_CORNERS
        self._scene_corners = context.buffer(as_float32(corners), dynamic=True)
        content = [
            (context.buffer(as_float32(np.array(corners) * self._size - 0.5)), "2f", "position_px"),
            (self._scene_corners, "2f", "texture_coordinate"),
        ]
        return {
            adds: context.vertex_array(program, content) for adds, program in self._programs.items()
        }

    def _drawn(self, texture: moderngl.Texture, mesh: moderngl.VertexArray) -> moderngl.Framebuffer:
        """A frame of the unwarped texture, to be copied into every frame."""
        frame = create_framebuffer(self._context, self._size, self._samples, with_depth=False)
        frame.use()
        frame.clear(alpha=1.0)
        self._context.enable_only(moderngl.NOTHING)
        texture.use()
        mesh.render()
        return frame
