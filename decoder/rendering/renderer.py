"""Draws the head over its background with OpenGL, offscreen.

Rows: the first row of OpenGL is the bottom one.  Everything is drawn upside down instead (clip y
increases downwards), so the first row read back is the top row, and front faces wind clockwise.
Channels: pictures are BGR throughout; GL treats blue as red.
Texture coordinates: pixel (row i, column j) of an atlas of n x n pixels has its centre at
u = (j + 0.5) / n, v = (i + 0.5) / n, v down; beyond the outermost centres the edge is repeated.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import moderngl
import numpy as np

from decoder.rendering.background_pass import BackgroundPass
from decoder.rendering.edge_pass import EdgePass
from decoder.rendering.gl_context import (
    as_float32,
    create_context,
    create_framebuffer,
    load_program,
    upload_picture,
    write_uniform,
)
from decoder.rendering.render_geometry import (
    NEAR_MM,
    clip_from_head,
    drawing_order,
    part_colours,
    teeth_falloff,
)
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.layers.light import Light
from shared_model.mesh import Head, inside_mouth
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

# An atlas with more texels per pixel is averaged (mipmaps); any other one is sampled bilinearly, as
# the encoder does when it fits the face.
COARSE_TEXELS_PER_PX = 3.0
ATLAS_MM = 200.0


@dataclass(frozen=True, slots=True)
class FrameState:
    """What is drawn of a frame.

    vertices: (n, 3) float64, mm, head frame, as many as the head has.
    grid_px: (rows, columns, 2) the warped mesh of the background, pixels; None: unchanged.
    mouth_shading: light inside the mouth, less on molars; None: the texture includes it.
    change: (h, w, 3) uint8 BGR, added to both layers of the background less 128; None: nothing.
    scene_corners: see `scene_motion.moved_corners`; None: the scene stands still.
    light: on both layers; None: as it is in them.
    texture: (n, m, 3) uint8 BGR; None: unchanged.
    """

    pose: Pose
    vertices: Array
    grid_px: Array | None = None
    mouth_shading: float | None = None
    change: Picture | None = None
    scene_corners: Array | None = None
    light: Light | None = None
    texture: Picture | None = None


class Renderer:
    """Draws one head at one picture size; owns the GL context, textures and buffers.

    width, height: size of the picture, pixels.
    head: topology, texture coordinates and opacity of what is drawn.
    samples: colour samples per pixel, 0 for one; more smooth all edges and take time.
    Raises `UserError` where there is no EGL.  Use as a context manager or call `close`.
    """

    def __init__(self, width: int, height: int, head: Head, samples: int = 0) -> None:
        self.width, self.height, self.head = width, height, head
        self._context = create_context()
        size = width, height
        try:
            self._target = create_framebuffer(self._context, size, samples)
            self._resolved = create_framebuffer(self._context, size, 0) if samples else self._target
        except moderngl.Error as error:
            raise UserError(f"cannot draw pictures of {width}x{height} here: {error}") from error
        # Read as it is drawn and converted after: GL takes four times as long to leave alpha out.
        self._read_px = np.empty((height, width, 4), np.uint8)
        self._background = BackgroundPass(self._context, size)
        self._atlas: moderngl.Texture | None = None
        self._positions = self._context.buffer(reserve=12 * len(head.vertices), dynamic=True)
        triangles, self._kinds = drawing_order(head)
        self._triangles = self._context.buffer(triangles)
        self._textured = self._head_array()
        depth, places = (
            load_program(self._context, "depth"),
            [(self._positions, "3f", "position_mm")],
        )
        self._depth = self._context.vertex_array(depth, places, self._triangles)
        self._edges = EdgePass(self._context, size, head)
        self._shaded: moderngl.VertexArray | None = None
        self._attributes: moderngl.Buffer | None = None

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free everything on the GL side."""
        self._context.release()

    def set_texture(self, atlas: Picture) -> None:
        """Set the texture of the head.  atlas: (n, m, 3) uint8 BGR."""
        with self._context as context:
            self._atlas = upload_picture(context, self._atlas, "atlas", atlas)

    def set_background(
        self, moving: Picture, grid_px: Array, static: Picture | None = None
    ) -> None:
        """Set the layers behind the head.

        moving: (h, w, 3) uint8 BGR, or (h, w, 4) with alpha; warped, and stretched to the size of
            the picture.
        static: (h, w, 3) uint8 BGR, behind `moving`; not warped.
        grid_px: (rows, columns, 2) float64, the unwarped mesh, pixels
            (`head_motion.BackgroundMesh.grid_px`).
        """
        with self._context:
            self._background.set(moving, grid_px, static)

    def submit(self, camera: Camera, frame: FrameState, expansion_px: float = 0.0) -> None:
        """Start drawing the textured head over the background; `read_back` waits for the picture.

        expansion_px: how far the colours of the face extend beyond its outline, pixels; if at
            all, edges are smooth, see `edge_strips`.
        """
        vertices, shading = frame.vertices, frame.mouth_shading
        if frame.texture is not None:
            self.set_texture(frame.texture)
        self._check(camera, vertices)
        if self._atlas is None:
            raise ValueError("no texture has been set, expected set_texture before submit")
        with self._context:
            self._clear(with_colour=not self._background.covers)
            layers = frame.grid_px, frame.change, frame.scene_corners, frame.light
            self._background.draw(self._target, *layers)
            clip = clip_from_head(camera, frame.pose)
            self._write_pose(self._textured, clip, vertices)
            write_uniform(self._depth.program, "clip_from_head", clip)
            if expansion_px:
                self._edges.set(clip, vertices, shading, expansion_px)
            self._textured.program["mouth_shading"] = 1.0 if shading is None else shading
            self._textured.program["texture_is_shaded"] = shading is None
            self._use_atlas(self._atlas, camera, frame.pose)
            self._draw_head(with_edges=expansion_px > 0)

    def draw_scene(self) -> Picture:
        """The picture submitted last without person and head: (height, width, 3) uint8 BGR."""
        with self._context:
            self._clear()
            self._background.draw_scene(self._target)
            return self._read()

    def read_back(self) -> Picture:
        """The picture submitted last: (height, width, 3) uint8 BGR."""
        with self._context:
            return self._read()

    def draw_shaded(
        self, camera: Camera, pose: Pose, vertices: Array, colours: Picture | None = None
    ) -> Picture:
        """The untextured head, lit, on dark grey: (height, width, 3) uint8 BGR.

        vertices: (n, 3) float64, mm, head frame.
        colours: (n, 3) uint8 BGR of each vertex; None: by part, see `part_colours`.
        """
        self._check(camera, vertices)
        if colours is None:
            colours = part_colours(self.head)
        normals = vertex_normals(vertices, self.head.triangles)
        with self._context as context:
            array = self._shaded_array(as_float32(normals), as_float32(colours / 255))
            self._clear(0.12)
            self._write_pose(array, clip_from_head(camera, pose), vertices)
            write_uniform(array.program, "camera_from_head", matrix_from_quaternion(pose.rotation))
            context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
            array.render()
            return self._read()

    def _head_array(self) -> moderngl.VertexArray:
        context, head = self._context, self.head
        attributes = np.column_stack(
            [head.texture_coordinates, head.opacity, inside_mouth(head), teeth_falloff(head)]
        )
        names = ("texture_coordinate", "vertex_opacity", "inside_mouth", "teeth_falloff")
        content = [
            (self._positions, "3f", "position_mm"),
            (context.buffer(as_float32(attributes)), "2f 1f 1f 1f", *names),
        ]
        return context.vertex_array(load_program(context, "head"), content, self._triangles)

    def _shaded_array(self, normals: Any, colours: Any) -> moderngl.VertexArray:
        attributes = np.concatenate([normals, colours], axis=1)
        if self._shaded is None or self._attributes is None:
            self._attributes = self._context.buffer(attributes, dynamic=True)
            self._shaded = self._context.vertex_array(
                load_program(self._context, "shaded"),
                [
                    (self._positions, "3f", "position_mm"),
                    (self._attributes, "3f 3f", "normal_head", "vertex_colour"),
                ],
                self._triangles,
            )
        self._attributes.write(attributes)
        return self._shaded

    def _check(self, camera: Camera, vertices: Array) -> None:
        if (camera.width, camera.height) != (self.width, self.height):
            size = f"{camera.width}x{camera.height}"
            raise ValueError(f"camera is {size}, expected {self.width}x{self.height}")
        if vertices.shape != self.head.vertices.shape:
            expected = self.head.vertices.shape
            raise ValueError(f"vertices have shape {vertices.shape}, expected {expected}")

    def _clear(self, grey: float = 0.0, with_colour: bool = True) -> None:
        self._target.color_mask = (with_colour,) * 4
        self._target.clear(grey, grey, grey, 1.0)
        self._target.color_mask = (True,) * 4
        self._target.use()
        # Clip y points down, which turns counter-clockwise into clockwise.
        self._context.front_face = "cw"
        self._context.cull_face = "back"

    def _write_pose(self, array: moderngl.VertexArray, clip: Array, vertices: Array) -> None:
        self._positions.write(as_float32(vertices))
        write_uniform(array.program, "clip_from_head", clip)

    def _use_atlas(self, atlas: moderngl.Texture, camera: Camera, pose: Pose) -> None:
        atlas_px = ATLAS_MM * camera.focal_px / max(float(pose.translation_mm[2]), NEAR_MM)
        if atlas.width > COARSE_TEXELS_PER_PX * atlas_px:
            atlas.build_mipmaps()
            atlas.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        else:
            atlas.filter = moderngl.LINEAR, moderngl.LINEAR
        atlas.use()

    def _draw_head(self, with_edges: bool) -> None:
        """Draw solid skin first, and what it hides by its depth not at all."""
        head, (solid, blended, clear) = self._textured, self._kinds
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        _render(head, 0, solid)
        if with_edges:
            self._edges.draw_outline(self._target)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
        _render(head, solid, blended)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._target.color_mask = (False,) * 4
        self._target.use()
        _render(self._depth, blended, clear)
        self._target.color_mask = (True,) * 4
        self._target.use()
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
        _render(head, clear, head.vertices)
        if with_edges:
            self._edges.draw_contours(self._target)

    def _read(self) -> Picture:
        if self._target is not self._resolved:
            self._context.copy_framebuffer(self._resolved, self._target)
        self._resolved.read_into(self._read_px, components=4)
        return np.asarray(cv2.cvtColor(self._read_px, cv2.COLOR_BGRA2BGR), np.uint8)


def _render(array: moderngl.VertexArray, first: int, end: int) -> None:
    """Draw the triangles of indices first to end."""
    if first < end:
        array.render(first=first, vertices=end - first)
