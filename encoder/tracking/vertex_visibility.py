"""Which points of the head the camera sees: by their normals, and by what stands before them."""

import numpy as np
from numpy.typing import NDArray

from shared_model.geometry import matrix_from_quaternion
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
Mask = NDArray[np.bool_]

# Skin seen at more than 70 degrees is too foreshortened to be followed.
_LEAST_COSINE = 0.34
# What lies less than this before a point is its own skin.
_CLEARANCE_MM = 2.0
_STEP_DEG = 5.0


class VertexVisibility:
    """Visibility of a few vertices of one mesh from any direction.

    Self-occlusion is looked up in cells of 5 degrees, each worked out when first needed.
    vertices: (n, 3) float64, mm, head frame.  triangles: (m, 3).  index: (k,) the vertices meant.
    """

    def __init__(self, vertices: Array, triangles: Indices, index: Indices) -> None:
        self._vertices, self._triangles, self._index = vertices, triangles, index
        self._normals = vertex_normals(vertices, triangles)[index]
        self._touching = (triangles[None] == index[:, None, None]).any(axis=2)
        self._cells: dict[tuple[int, int], Mask] = {}

    def visible(self, pose: Pose) -> Mask:
        """(k,) whether the camera sees each vertex when the head has this pose."""
        camera_in_head = -matrix_from_quaternion(pose.rotation).T @ pose.translation_mm
        towards = camera_in_head / np.linalg.norm(camera_in_head)
        facing = self._normals @ towards > _LEAST_COSINE
        yaw = np.degrees(np.arctan2(towards[0], towards[2]))
        pitch = np.degrees(np.arcsin(np.clip(towards[1], -1, 1)))
        cell = round(yaw / _STEP_DEG), round(pitch / _STEP_DEG)
        if cell not in self._cells:
            self._cells[cell] = self._free(*np.radians(np.array(cell) * _STEP_DEG))
        return np.asarray(facing & self._cells[cell])

    def _free(self, yaw: float, pitch: float) -> Mask:
        """(k,) whether nothing stands between each vertex and a far camera in this direction."""
        towards = np.array(
            [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)]
        )
        right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
        axes = np.column_stack([right, np.cross(towards, right), towards])
        turned = self._vertices @ axes
        corners, points = turned[self._triangles], turned[self._index]
        # Barycentric coordinates of every point in every triangle, seen along the direction.
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        area = _cross(b - a, c - a)
        flat = np.abs(area) < 1e-9
        area = np.where(flat, 1.0, area)
        offset = points[:, None] - a[None]
        v = _cross(offset, (c - a)[None]) / area
        w = _cross((b - a)[None], offset) / area
        depth = a[:, 2] + v * (b - a)[:, 2] + w * (c - a)[:, 2]
        before = depth > points[:, None, 2] + _CLEARANCE_MM
        hit = (v >= 0) & (w >= 0) & (v + w <= 1) & before & ~flat & ~self._touching
        return np.asarray(~hit.any(axis=1))


def _cross(p: Array, q: Array) -> Array:
    """Cross product of the first two coordinates."""
    return np.asarray(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])
