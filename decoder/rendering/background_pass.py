"""Draws the warped background picture: the pass before the head."""

import cv2
import moderngl
import numpy as np

from decoder.rendering.gl_context import as_float32, load_program, upload_picture, write_mipmaps
from decoder.rendering.layer_colours import NO_CHANGE, changed_layers, with_alpha
from decoder.rendering.render_geometry import grid_triangles, shown_triangles, unseen_strips
from shared_model.arrays import Array, Picture
from shared_model.layers.light import SAME_LIGHT, Light
from shared_model.layers.scene_motion import PICTURE_CORNERS

# Where a camera shows what it has never shown the scene is mirrored at its edge: as blurred as can
# be from this share of its sides on.
UNSEEN_FADE = 0.05
# Of the mipmap: see `unseen_scene.frag`.
MOST_BLURRED_LEVEL = 5


class BackgroundPass:
    """The layers of the background in a GL context; draws nothing before `set`.

    size: of the frames, (width, height), pixels.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int]) -> None:
        self._context, self._size = context, size
        self._program = load_program(context, "background")
        # A program of its own is faster than an `if`: llvmpipe draws both ways everywhere.
        self._unseen = load_program(context, "unseen_scene", vertex="background")
        self._unseen["fade"], self._unseen["most_blurred"] = UNSEEN_FADE, MOST_BLURRED_LEVEL
        for program in (self._program, self._unseen):
            program["picture_px"] = size
        self._has_mipmaps = False  # of the scene as it is now
        self._mipmapped: moderngl.Texture | None = None  # has room for mipmaps
        self._layers: list[Picture] = []  # moving and, if there is one, static, BGRA
        self._drawn = self._layers  # with the change and light of the textures
        self._moving: moderngl.Texture | None = None
        self._static: moderngl.Texture | None = None
        self._is_changed = False  # the textures hold layers with a change or light
        self._mesh: moderngl.VertexArray | None = None
        self._solid = 0  # indices of the mesh, the first ones, of triangles without transparency
        self._grid: moderngl.Buffer | None = None
        self._static_frame: moderngl.Framebuffer | None = None
        # As it is, and mirrored where it was never seen.
        self._scenes: tuple[moderngl.VertexArray, moderngl.VertexArray] | None = None
        self._scene_corners: moderngl.Buffer | None = None
        self._last_corners: Array | None = None  # where the scene was drawn last

    @property
    def covers(self) -> bool:
        """Whether `draw` draws every pixel."""
        return self._static_frame is not None

    def set(self, moving: Picture, grid_px: Array, static: Picture | None) -> None:
        """See `Renderer.set_background`."""
        context = self._context
        self._layers = [with_alpha(moving)]
        coordinates = as_float32((grid_px.reshape(-1, 2) + 0.5) / self._size)
        self._grid = context.buffer(as_float32(grid_px), dynamic=True)
        content = [
            (self._grid, "2f", "position_px"),
            (context.buffer(coordinates), "2f", "texture_coordinate"),
        ]
        solid, blended = shown_triangles(grid_triangles(*grid_px.shape[:2]), coordinates, moving)
        self._solid = solid.size
        shown = context.buffer(np.concatenate([solid, blended]))
        self._mesh = context.vertex_array(self._program, content, shown)
        self._static_frame = None
        if static is not None:
            if static.shape[1::-1] != self._size:
                static = np.asarray(cv2.resize(static, self._size), np.uint8)
            self._layers.append(with_alpha(static))
        self._upload(self._layers)
        if self._static is not None and static is not None:
            self._static_frame = context.framebuffer([self._static])
            self._scenes = self._whole_pictures()
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
        if self._mesh is None or self._grid is None or self._moving is None:
            return
        if grid_px is not None:
            self._grid.write(as_float32(grid_px))
        if change is not None and (change == NO_CHANGE).all():
            change = None
        is_changed = change is not None or light not in (None, SAME_LIGHT)
        if is_changed or self._is_changed:
            self._upload(changed_layers(self._layers, change, light or SAME_LIGHT))
            self._is_changed = is_changed
        self._last_corners = scene_corners
        self.draw_scene(target)
        self._context.enable_only(moderngl.NOTHING)
        self._moving.use()
        if self._solid:
            self._mesh.render(vertices=self._solid)
        if self._static_frame is not None:
            self._context.enable_only(moderngl.BLEND)
        if self._solid < self._mesh.vertices:
            self._mesh.render(first=self._solid, vertices=self._mesh.vertices - self._solid)

    def draw_scene(self, target: moderngl.Framebuffer) -> None:
        """Draw the layer that does not move with the person, as `draw` has drawn it last."""
        if self._static_frame is None or self._static is None:
            return
        if self._last_corners is None:
            self._context.copy_framebuffer(target, self._static_frame)
            return
        assert self._scenes is not None and self._scene_corners is not None
        self._scene_corners.write(as_float32(self._last_corners))
        self._context.enable_only(moderngl.NOTHING)
        self._static.use()
        seen, unseen = self._scenes
        seen.render(moderngl.TRIANGLE_STRIP)
        strips = unseen_strips(self._last_corners, self._size)
        if not strips:
            return
        self._make_mipmaps(self._static)
        self._static.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        for strip in strips:
            target.scissor = strip
            unseen.render(moderngl.TRIANGLE_STRIP)
        target.scissor = 0, 0, *self._size
        # Of all that is seen the mipmaps would be sampled in vain, for twice the time.
        self._static.filter = moderngl.LINEAR, moderngl.LINEAR

    def _make_mipmaps(self, static: moderngl.Texture) -> None:
        """Make the mipmaps of the scene as it is now."""
        if self._mipmapped is not static:
            # Makes room for them.
            static.build_mipmaps(max_level=MOST_BLURRED_LEVEL)
            self._mipmapped = static
        if not self._has_mipmaps:
            write_mipmaps(static, self._drawn[1], MOST_BLURRED_LEVEL)
            self._has_mipmaps = True

    def _upload(self, layers: list[Picture]) -> None:
        context, self._drawn = self._context, layers
        self._moving = upload_picture(context, self._moving, "background", layers[0])
        if len(layers) > 1:
            self._static = upload_picture(context, self._static, "static background", layers[1])
            self._has_mipmaps = False

    def _whole_pictures(self) -> tuple[moderngl.VertexArray, moderngl.VertexArray]:
        """Two triangles over the whole picture, for each program."""
        context, corners = self._context, PICTURE_CORNERS
        self._scene_corners = context.buffer(as_float32(corners), dynamic=True)
        content = [
            (context.buffer(as_float32(np.array(corners) * self._size - 0.5)), "2f", "position_px"),
            (self._scene_corners, "2f", "texture_coordinate"),
        ]
        seen, unseen = (
            context.vertex_array(program, content) for program in (self._program, self._unseen)
        )
        return seen, unseen
