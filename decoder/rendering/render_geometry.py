"""Arrays for drawing the head and its background: matrices, selected triangles, colours."""

import cv2
import numpy as np

from shared_model.arrays import Array, Picture, Single, VertexIndices
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.mesh import PARTS, Head
from shared_model.parameters import Pose

# Depth that is drawn before and behind the head's origin, but nothing nearer than NEAR_MM.
DEPTH_RANGE_MM = 500.0
NEAR_MM = 10.0
# Depth of the front teeth; behind them the light falls to 1 / e over the second distance.
FRONT_TEETH_MM, TEETH_FADE_MM = 12.0, 8.0
# BGR of the parts of the untextured head.
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


def drawing_order(head: Head) -> tuple[VertexIndices, tuple[int, int, int]]:
    """All triangles (m, 3) in the order in which they are drawn, and where the first kinds end.

    Kinds: opaque skin and surround; partly transparent; wholly transparent, which hides the inside
    of the head by its depth; the inside.  Ends of the first three are counted in indices.
    """
    is_skin = np.isin(head.parts, [PARTS.index(part) for part in ("skin", "surround")])
    outside = np.asarray(is_skin[head.triangles].all(1))
    opacity = head.opacity[head.triangles]
    is_solid, is_clear = outside & (opacity.min(1) == 1), outside & (opacity.max(1) == 0)
    kinds = is_solid, outside & ~is_solid & ~is_clear, is_clear, ~outside
    ordered = np.concatenate([head.triangles[kind] for kind in kinds])
    solid, blended, clear = np.cumsum([3 * int(kind.sum()) for kind in kinds[:3]]).tolist()
    return np.ascontiguousarray(ordered, np.int32), (solid, blended, clear)


def teeth_falloff(head: Head) -> Array:
    """(n,) light at each vertex, relative to that on the front teeth; 1 off the teeth."""
    teeth = np.isin(head.parts, [PARTS.index(part) for part in ("teeth_upper", "teeth_lower")])
    front_mm = float(head.vertices[teeth, 2].max(initial=-np.inf))
    behind_mm = np.maximum(front_mm - FRONT_TEETH_MM - head.vertices[:, 2], 0)
    return np.where(teeth, np.exp(-behind_mm / TEETH_FADE_MM), 1.0)


def part_colours(head: Head) -> Picture:
    """(n, 3) uint8 BGR of each vertex of an untextured head, by part."""
    return np.array([PART_COLOURS[part] for part in PARTS], dtype=np.uint8)[head.parts]


def grid_triangles(rows: int, columns: int) -> VertexIndices:
    """(m, 3) two triangles for each cell of a grid of points, row by row."""
    corner = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)


def grid_quads(count: int) -> VertexIndices:
    """(2 * count, 3) two triangles for each of `count` quadrilaterals of four vertices."""
    first = 4 * np.arange(count, dtype=np.int32)[:, None, None]
    return (first + np.array([(0, 1, 2), (0, 2, 3)], np.int32)).reshape(-1, 3)


def shown_triangles(
    triangles: VertexIndices, coordinates: Single, picture: Picture
) -> tuple[VertexIndices, VertexIndices]:
    """Those of triangles (m, 3) on which a picture has no transparency; and those with some.

    Those on which it is wholly transparent are left out.
    coordinates: (n, 2) of the vertices in the picture (h, w, 3) or (h, w, 4), 0..1.
    Returns at least one triangle.
    """
    if picture.shape[2] == 3:
        return triangles, triangles[:0]
    first, second, third = coordinates[triangles.T] * (picture.shape[1], picture.shape[0])
    # Faster than minimum and maximum along the axis of the corners.
    least = np.minimum(np.minimum(first, second), third)
    most = np.maximum(np.maximum(first, second), third)
    # With bilinear interpolation the texels next to a triangle affect it; with several samples a
    # pixel that it only touches takes its colour from beyond.
    ends = np.floor(least).astype(int) - 2, np.ceil(most).astype(int) + 2
    (left, top), (right, bottom) = (np.clip(end, 0, picture.shape[1::-1]).T for end in ends)
    alpha = np.ascontiguousarray(picture[..., 3])
    clear, dense = (
        count[bottom, right] - count[top, right] - count[bottom, left] + count[top, left]
        for count in (cv2.integral((alpha == value).astype(np.uint8)) for value in (0, 255))
    )
    area = (right - left) * (bottom - top)
    is_solid, is_blended = dense == area, (dense < area) & (clear < area)
    if not (is_solid | is_blended).any():
        return triangles[:0], triangles[:1]
    return triangles[is_solid], triangles[is_blended]


def unseen_strips(corners: Array, size: tuple[int, int]) -> list[tuple[int, int, int, int]]:
    """Left, top, width, height, pixels, of what a frame of `size` shows beyond the scene's picture.

    corners: (4, 2) where in that picture, 0 to 1, the frame's corners come from, see
        `scene_motion.moved_corners`.
    """
    strips = []
    for axis, length in enumerate(size):
        # Along each line from one side to the other, diagonals too, places change linearly.
        lines = [(0, 1), (2, 3), (0, 3), (2, 1)] if axis == 0 else [(0, 2), (1, 3), (0, 3), (1, 2)]
        for is_far in (False, True):
            ends = np.array([corners[list(line), axis] for line in lines])
            first, last = (1 - ends).T[::-1] if is_far else ends.T
            # All of a line whose other end is beyond that side as well.
            share = np.where(first < 0, np.minimum(first - last, first), 1.0)
            beyond = np.where(first < 0, first / share, 0.0)
            depth = min(int(np.ceil(length * beyond.max() + 1)), length) if beyond.any() else 0
            at = length - depth if is_far else 0
            if depth:
                strips.append((at, 0, depth, size[1]) if axis == 0 else (0, at, size[0], depth))
    return strips
