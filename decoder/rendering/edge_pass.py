"""Draws the smooth edges of the head in two passes: those of solid skin, then all others."""

import moderngl
import numpy as np

from decoder.rendering.edge_strips import VERTEX_FLOATS, edge_strips, edges_of
from decoder.rendering.gl_context import as_float32, load_program
from decoder.rendering.render_geometry import grid_quads, teeth_falloff
from shared_model.arrays import Array
from shared_model.mesh import Head, inside_mouth

# The head covers so much of a pixel in whose middle its edge is.
HALF_PX = 0.5


class EdgePass:
    """The strips along the edges of a head in a GL context, see `edge_strips`.

    size: of the frames, (width, height), pixels.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], head: Head) -> None:
        self._context, self._size = context, size
        self._inside, self._falloff = inside_mouth(head), teeth_falloff(head)
        self._mesh = edges_of(head)
        attributes = [head.texture_coordinates, head.opacity, np.ones(len(head.vertices))]
        self._shown = as_float32(np.column_stack(attributes))
        self._strips = np.zeros((len(head.triangles) * 3, 4, VERTEX_FLOATS), np.float32)
        self._program = load_program(context, "edge")
        self._vertices = context.buffer(reserve=self._strips.nbytes, dynamic=True)
        names = "position_clip", "texture_coordinate", "vertex_opacity", "vertex_light"
        content = [(self._vertices, "3f 2f 1f 1f 1f", *names, "vertex_distance_px")]
        quads = context.buffer(grid_quads(len(self._strips)))
        self._array = context.vertex_array(self._program, content, quads)
        self._outer = self._count = 0  # strips, those outside the mouth first
        self._reach_px = 0.0

    def set(
        self, clip: Array, vertices: Array, mouth_shading: float | None, expansion_px: float
    ) -> None:
        """Find the edges of a frame.

        clip: (4, 4), see `render_geometry.clip_from_head`.
        vertices: (n, 3) float64, mm, head frame.
        mouth_shading, expansion_px: see `Renderer.submit`.
        """
        self._reach_px = expansion_px + HALF_PX
        self._shown[:, 3] = 1.0
        if mouth_shading is not None:
            self._shown[:, 3] = self._falloff * np.where(self._inside, mouth_shading, 1.0)
        posed, reach_px = (clip, self._size, vertices), self._reach_px
        self._outer, self._count = edge_strips(
            *posed, self._mesh, self._shown, reach_px, self._strips
        )
        if self._count:
            self._vertices.write(self._strips[: self._count])

    def draw_outline(self, target: moderngl.Framebuffer) -> None:
        """Draw the expanded edges behind all of the head that has been drawn into `target`.

        Transparent skin hides the inside of the mouth by its depth, but is drawn after that.
        """
        self._draw(target, self._outer, True, self._reach_px)

    def draw_contours(self, target: moderngl.Framebuffer) -> None:
        """Draw the edges, not expanded, before what is behind them in `target`."""
        self._draw(target, self._count, False, HALF_PX)

    def _draw(
        self, target: moderngl.Framebuffer, count: int, is_behind: bool, reach_px: float
    ) -> None:
        if not count:
            return
        self._program["behind_head"], self._program["reach_px"] = is_behind, reach_px
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        target.depth_mask = False
        self._array.render(vertices=6 * count)
        target.depth_mask = True
