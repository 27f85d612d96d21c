"""Draws the head over its backdrop with OpenGL, offscreen.  The only file that imports moderngl.

Rows: OpenGL's first row is the bottom one.  Everything here is drawn upside down instead (clip y
grows downwards), so row 0 of what is read back is the top row, and front faces wind clockwise.
Channels: pictures go in and come out as BGR; GL takes the blue for red and never knows better.
Texture coordinates: pixel (row i, column j) of an atlas of n x n pixels has its centre at
u = (j + 0.5) / n, v = (i + 0.5) / n, v down; beyond the outermost centres the edge is repeated.
"""

from importlib.resources import files
from types import TracebackType
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from shared_model.errors import UserError
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.mesh import PARTS, Head, inside_mouth, open_edges
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# What is drawn, mm before and behind the head's origin; nothing nearer than NEAR_MM.
DEPTH_RANGE_MM = 500.0
NEAR_MM = 10.0
# The cosine below which a triangle may be at the outline of the head.
GRAZING_COSINE = 0.7
# An atlas this many times finer than the picture is averaged (mipmaps), else drawn as it is: what
# has been fitted through plain bilinear sampling must be shown by it.
COARSE_TEXELS_PER_PX = 3.0
ATLAS_MM = 200.0

# The front teeth reach so far back; behind them light fades to 1 / e within so much more.
FRONT_TEETH_MM, TEETH_FADE_MM = 12.0, 8.0
# BGR of the untextured head's parts, in the order of `PARTS`.
PART_COLOURS = {
    "skin": (150, 180, 225),
    "eye_left": (235, 238, 240),
    "eye_right": (235, 238, 240),
    "teeth_upper": (215, 232, 238),
    "teeth_lower": (215, 232, 238),
    "tongue": (110, 100, 190),
    "mouth": (70, 60, 130),
    "surround": (90, 90, 90),
}


def create_context() -> moderngl.Context:
    """An offscreen OpenGL context.  Raises `UserError` where there is no EGL."""
    try:
        return moderngl.create_context(standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # glcontext raises bare Exception, ImportError or OSError
        raise UserError(
            "cannot draw without a screen: no EGL with OpenGL 3.3; install libegl1 libgl1"
        ) from error


def clip_from_head(camera: Camera, pose: Pose) -> Array:
    """(4, 4) matrix from head-frame mm to clip coordinates with y down (eq. 4.6 after eq. 4.5).

    Agrees with `geometry.pixel_from_head`: pixel centres lie at whole numbers, so pixel u spans
    u - 1/2 to u + 1/2 and the principal point (width - 1) / 2 is the middle of clip space.
    """
    near = max(float(pose.translation_mm[2]) - DEPTH_RANGE_MM, NEAR_MM)
    far = max(float(pose.translation_mm[2]) + DEPTH_RANGE_MM, near + DEPTH_RANGE_MM)
    clip_from_camera = np.zeros((4, 4))
    clip_from_camera[0, 0] = 2 * camera.focal_px / camera.width
    clip_from_camera[1, 1] = 2 * camera.focal_px / camera.height
    clip_from_camera[2, 2:] = (far + near) / (far - near), -2 * far * near / (far - near)
    clip_from_camera[3, 2] = 1
    camera_from_head = np.eye(4)
    camera_from_head[:3, :3] = matrix_from_quaternion(pose.rotation)
    camera_from_head[:3, 3] = pose.translation_mm
    return clip_from_camera @ camera_from_head


def expanded_silhouette(clip: Array, vertices: Array, camera: Camera, expansion_px: float) -> Array:
    """The matrix `clip` that draws the head about its middle, its outline `rim_px` further out."""
    homogeneous = np.column_stack([vertices, np.ones(len(vertices))]) @ clip.T
    flat = homogeneous[:, :2] / homogeneous[:, 3:]
    low, high = flat.min(0), flat.max(0)
    middle = (low + high) / 2
    factor = 1 + 2 * expansion_px * 2 / (np.array([camera.width, camera.height]) * (high - low))
    wide = clip.copy()
    wide[:2] = factor[:, None] * clip[:2] + ((1 - factor) * middle)[:, None] * clip[3]
    return wide


class Renderer:
    """Draws one head at one picture size; holds the GL context, textures and buffers.

    width, height: size of the picture, pixels.
    head: topology, texture coordinates and opacity of what is drawn.
    samples: colour samples per pixel, 0 for one; more smooths the silhouette and costs time.
    Raises `UserError` where there is no EGL.  Use as a context manager or call `close`.
    """

    def __init__(self, width: int, height: int, head: Head, samples: int = 0) -> None:
        self.width, self.height, self.head, self._samples = width, height, head, samples
        self._context = create_context()
        # What nobody refers to any more is freed when `gc` is called.
        self._context.gc_mode = "context_gc"
        try:
            self._target = self._framebuffer(samples)
            self._resolved = self._framebuffer(0) if samples else self._target
        except moderngl.Error as error:
            raise UserError(f"cannot draw pictures of {width}x{height} here: {error}") from error
        self._textures: dict[str, moderngl.Texture] = {}
        self._positions = self._context.buffer(reserve=12 * len(head.vertices), dynamic=True)
        self._silhouette_triangles = self._context.buffer(
            reserve=head.triangles.nbytes, dynamic=True
        )
        self._textured, self._silhouette = self._head_arrays()
        opacity = head.opacity[head.triangles]
        # Skin of opacity 0 hides the inside of the head, but not in a rim, which knows no depth.
        inside = inside_mouth(head)[head.triangles[:, 0]]
        self._visible_triangles = head.triangles[(opacity.max(1) > 0) & ~inside]
        blended = head.triangles[opacity.min(1) < 1]
        near_ends = self._visible_triangles[
            np.isin(self._visible_triangles, open_edges(self._visible_triangles)).any(1)
        ]
        gaps = np.concatenate([blended, near_ends])
        self._borders_gap = np.asarray(np.isin(self._visible_triangles, gaps).any(1))
        self._shaded: moderngl.VertexArray | None = None
        self._attributes: moderngl.Buffer | None = None
        self._background: moderngl.VertexArray | None = None
        self._static_background: moderngl.Framebuffer | None = None
        self._grid: moderngl.Buffer | None = None

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free everything on the GL side."""
        self._context.release()

    def set_texture(self, atlas: Picture) -> None:
        """Set what the head wears.  atlas: (n, m, 3) uint8 BGR."""
        self._set_picture("atlas", atlas)

    def set_background(
        self, moving: Picture, grid_px: Array, static: Picture | None = None
    ) -> None:
        """Set what stands behind the head.

        still: (h, w, 3) uint8 BGR, stretched over the picture if it is of another size; or
            (h, w, 4) with its opacity.
        behind: (h, w, 3) uint8 BGR, what shows through and is never warped.
        grid_px: (rows, columns, 2) float64, where the mesh that warps it lies in the picture when
            it is not warped, pixels (`composite.Backdrop.grid_px`).
        """
        self._set_picture("still", moving)
        if static is not None:
            self._set_picture("behind", static)
        rows, columns = grid_px.shape[:2]
        picture_px = (self.width, self.height)
        coordinates = _single((grid_px.reshape(-1, 2) + 0.5) / picture_px)
        with self._context as context:
            program = _program(context, "backdrop")
            program["picture_px"] = picture_px
            self._grid = context.buffer(_single(grid_px), dynamic=True)
            at, triangles = context.buffer(coordinates), _grid_triangles(rows, columns)

            def mesh(chosen: NDArray[np.int32]) -> moderngl.VertexArray:
                places = [(self._grid, "2f", "position_px"), (at, "2f", "texture_coordinate")]
                drawn: moderngl.VertexArray = context.vertex_array(
                    program, places, context.buffer(chosen)
                )
                return drawn

            self._background = mesh(_visible_triangles(triangles, coordinates, moving))
            self._static_background = (
                None if static is None else self._render_static(mesh(triangles), "behind")
            )
            context.gc()

    def draw(
        self,
        camera: Camera,
        pose: Pose,
        vertices: Array,
        grid_px: Array | None = None,
        mouth_shading: float | None = None,
        expansion_px: float = 0.0,
    ) -> Picture:
        """The textured head over the backdrop: (height, width, 3) uint8 BGR.  See `begin`."""
        self.submit(camera, pose, vertices, grid_px, mouth_shading, expansion_px)
        return self.read_back()

    def submit(
        self,
        camera: Camera,
        pose: Pose,
        vertices: Array,
        grid_px: Array | None = None,
        mouth_shading: float | None = None,
        expansion_px: float = 0.0,
    ) -> None:
        """Have a picture drawn, beside what the caller does until it asks for `picture`.

        vertices: (n, 3) float64, mm, head frame, as many as the head has.
        grid_px: where the backdrop's mesh lies now, pixels; None: as it was last.
        mouth_light: what the inside of the mouth is darkened by, molars more; None: its light is
            painted.
        rim_px: by how much the face's own colours reach beyond its outline, pixels.
        """
        self._check(camera, vertices)
        if "atlas" not in self._textures:
            raise ValueError("no texture has been set, expected set_texture before draw")
        with self._context as context:
            self._clear()
            self._draw_background(grid_px)
            self._write_pose(self._textured, camera, pose, vertices)
            self._textured.program["mouth_light"] = 1.0 if mouth_shading is None else mouth_shading
            self._textured.program["painted_light"] = mouth_shading is None
            self._use_atlas(camera, pose)
            if expansion_px:
                _write_uniform(
                    self._textured.program,
                    "clip_from_head",
                    expanded_silhouette(
                        clip_from_head(camera, pose), vertices, camera, expansion_px
                    ),
                )
                context.enable_only(moderngl.CULL_FACE | moderngl.BLEND)
                outline = silhouette_triangles(
                    self._visible_triangles, self._borders_gap, pose, vertices
                )
                self._silhouette_triangles.write(outline)
                self._silhouette.render(vertices=outline.size)
                _write_uniform(
                    self._textured.program, "clip_from_head", clip_from_head(camera, pose)
                )
            context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
            self._textured.render()

    def read_back(self) -> Picture:
        """The picture that was begun last: (height, width, 3) uint8 BGR."""
        with self._context:
            return self._read()

    def draw_shaded(
        self, camera: Camera, pose: Pose, vertices: Array, colours: Picture | None = None
    ) -> Picture:
        """The head without its texture, lit, on dark grey: (height, width, 3) uint8 BGR.

        vertices: (n, 3) float64, mm, head frame.
        colours: (n, 3) uint8 BGR of each vertex; None: skin, eyes, teeth by the head's parts.
        """
        self._check(camera, vertices)
        if colours is None:
            colours = part_colours(self.head)
        normals = vertex_normals(vertices, self.head.triangles)
        with self._context as context:
            array = self._shaded_array(_single(normals), _single(colours / 255))
            self._clear(0.12)
            self._write_pose(array, camera, pose, vertices)
            rotation = matrix_from_quaternion(pose.rotation)
            _write_uniform(array.program, "camera_from_head", rotation)
            context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
            array.render()
            return self._read()

    def _framebuffer(self, samples: int, is_deep: bool = True) -> moderngl.Framebuffer:
        """is_deep: whether it tells near from far."""
        size, context = (self.width, self.height), self._context
        depth = context.depth_renderbuffer(size, samples=samples) if is_deep else None
        return context.framebuffer([context.renderbuffer(size, 4, samples=samples)], depth)

    def _render_static(self, mesh: moderngl.VertexArray, name: str) -> moderngl.Framebuffer:
        """What is the same in every frame: a texture on a mesh that does not move."""
        drawn = self._framebuffer(self._samples, is_deep=False)
        drawn.use()
        drawn.clear(alpha=1.0)
        self._context.enable_only(moderngl.NOTHING)
        self._textures[name].use()
        mesh.render()
        return drawn

    def _head_arrays(self) -> tuple[moderngl.VertexArray, moderngl.VertexArray]:
        """Of all triangles, and of those in `_outline_triangles`."""
        context, head = self._context, self.head
        inside = inside_mouth(head)
        fading = teeth_falloff(head)
        attributes = np.column_stack([head.texture_coordinates, head.opacity, inside, fading])
        names = ("texture_coordinate", "vertex_opacity", "inside_mouth", "fading")
        content = [
            (self._positions, "3f", "position_mm"),
            (context.buffer(_single(attributes)), "2f 1f 1f 1f", *names),
        ]
        triangles = context.buffer(np.ascontiguousarray(head.triangles, dtype=np.int32))
        program = _program(context, "head")
        whole, outline = (
            context.vertex_array(program, content, chosen)
            for chosen in (triangles, self._silhouette_triangles)
        )
        return whole, outline

    def _shaded_array(self, normals: Any, colours: Any) -> moderngl.VertexArray:
        attributes = np.concatenate([normals, colours], axis=1)
        if self._shaded is None or self._attributes is None:
            self._attributes = self._context.buffer(attributes, dynamic=True)
            self._shaded = self._context.vertex_array(
                _program(self._context, "shaded"),
                [
                    (self._positions, "3f", "position_mm"),
                    (self._attributes, "3f 3f", "normal_head", "vertex_colour"),
                ],
                self._context.buffer(np.ascontiguousarray(self.head.triangles, dtype=np.int32)),
            )
        self._attributes.write(attributes)
        return self._shaded

    def _set_picture(self, name: str, picture: Picture) -> None:
        if picture.ndim != 3 or picture.shape[2] not in (3, 4) or picture.dtype != np.uint8:
            raise ValueError(
                f"{name} is {picture.dtype} {picture.shape}, expected uint8 (h, w, 3 or 4)"
            )
        size = picture.shape[1], picture.shape[0]
        with self._context as context:
            texture, components = self._textures.get(name), picture.shape[2]
            if texture is None or (texture.size, texture.components) != (size, components):
                texture = context.texture(size, components, alignment=1)
                texture.repeat_x = texture.repeat_y = False
                self._textures[name] = texture
            texture.write(np.ascontiguousarray(picture), alignment=1)

    def _check(self, camera: Camera, vertices: Array) -> None:
        if (camera.width, camera.height) != (self.width, self.height):
            raise ValueError(
                f"camera is {camera.width}x{camera.height}, expected {self.width}x{self.height}"
            )
        if vertices.shape != self.head.vertices.shape:
            raise ValueError(
                f"vertices have shape {vertices.shape}, expected {self.head.vertices.shape}"
            )

    def _clear(self, grey: float = 0.0) -> None:
        self._target.use()
        self._target.clear(grey, grey, grey, 1.0)
        # Clip y points down, which turns counter-clockwise into clockwise.
        self._context.front_face = "cw"
        self._context.cull_face = "back"

    def _write_pose(
        self, array: moderngl.VertexArray, camera: Camera, pose: Pose, vertices: Array
    ) -> None:
        self._positions.write(_single(vertices))
        _write_uniform(array.program, "clip_from_head", clip_from_head(camera, pose))

    def _use_atlas(self, camera: Camera, pose: Pose) -> None:
        atlas = self._textures["atlas"]
        atlas_px = ATLAS_MM * camera.focal_px / max(float(pose.translation_mm[2]), NEAR_MM)
        if atlas.width > COARSE_TEXELS_PER_PX * atlas_px:
            atlas.build_mipmaps()
            atlas.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        else:
            atlas.filter = moderngl.LINEAR, moderngl.LINEAR
        atlas.use()

    def _draw_background(self, grid_px: Array | None) -> None:
        if self._background is None or self._grid is None:
            return
        if grid_px is not None:
            self._grid.write(_single(grid_px))
        self._context.enable_only(moderngl.NOTHING)
        if self._static_background is not None:
            self._context.copy_framebuffer(self._target, self._static_background)
            self._context.enable_only(moderngl.BLEND)
        self._textures["still"].use()
        self._background.render()

    def _read(self) -> Picture:
        if self._target is not self._resolved:
            self._context.copy_framebuffer(self._resolved, self._target)
        data = bytearray(self.height * self.width * 3)
        self._resolved.read_into(data, components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(self.height, self.width, 3)


def silhouette_triangles(
    triangles: NDArray[np.int32], borders_gap: NDArray[np.bool_], pose: Pose, vertices: Array
) -> NDArray[np.int32]:
    """Those of triangles (m, 3) that may show beside what is drawn over them: seen aslant, or
    `beside_gaps` (m,), where they end or what is behind shines through.

    vertices: (n, 3) float64, mm, head frame.
    """
    # Coordinates come first, triangles last: quick to add up.
    corners = _single(vertices).T[:, triangles.T]
    first, second, third = corners.transpose(1, 0, 2)
    ahead, behind = second - first, third - first
    normals = ahead[[1, 2, 0]] * behind[[2, 0, 1]] - ahead[[2, 0, 1]] * behind[[1, 2, 0]]
    camera_mm = -pose.translation_mm @ matrix_from_quaternion(pose.rotation)
    towards = _single(camera_mm)[:, None] - first
    facing = (normals * towards).sum(0)
    aslant = facing**2 < GRAZING_COSINE**2 * (normals**2).sum(0) * (towards**2).sum(0)
    chosen: NDArray[np.int32] = triangles[(facing > 0) & (aslant | borders_gap)]
    return chosen


def teeth_falloff(head: Head) -> Array:
    """(n,) what part of the light on the front teeth comes to each vertex: less to molars."""
    teeth = np.isin(head.parts, [PARTS.index(part) for part in ("teeth_upper", "teeth_lower")])
    front_mm = float(head.vertices[teeth, 2].max(initial=-np.inf))
    behind_mm = np.maximum(front_mm - FRONT_TEETH_MM - head.vertices[:, 2], 0)
    return np.where(teeth, np.exp(-behind_mm / TEETH_FADE_MM), 1.0)


def part_colours(head: Head) -> Picture:
    """(n, 3) uint8 BGR of each vertex of an untextured head, by its part."""
    return np.array([PART_COLOURS[part] for part in PARTS], dtype=np.uint8)[head.parts]


def _single(array: Any) -> NDArray[np.float32]:
    return np.ascontiguousarray(array, dtype=np.float32)


def _program(context: moderngl.Context, name: str) -> moderngl.Program:
    folder = files("decoder") / "shaders"
    return context.program(
        vertex_shader=(folder / f"{name}.vert").read_text(),
        fragment_shader=(folder / f"{name}.frag").read_text(),
    )


def _write_uniform(program: moderngl.Program, name: str, matrix: Array) -> None:
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform)
    uniform.write(_single(matrix.T))


def _grid_triangles(rows: int, columns: int) -> NDArray[np.int32]:
    corner = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)


def _visible_triangles(
    triangles: NDArray[np.int32], coordinates: NDArray[np.float32], still: Picture
) -> NDArray[np.int32]:
    """Those of triangles (m, 3) on which a still shows at all: much of one is cut out.

    coordinates: (n, 2) of the vertices in the still.  At least one is returned.
    """
    if still.shape[2] == 3:
        return triangles
    corners = coordinates[triangles] * (still.shape[1], still.shape[0])
    # Texels are interpolated: those beside a triangle count.
    ends = np.floor(corners.min(1)).astype(int) - 1, np.ceil(corners.max(1)).astype(int) + 1
    (left, top), (right, bottom) = (np.clip(end, 0, still.shape[1::-1]).T for end in ends)
    count = np.pad((still[..., 3] > 0).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    inside = count[bottom, right] - count[top, right] - count[bottom, left] + count[top, left]
    return triangles[inside > 0] if inside.any() else triangles[:1]
