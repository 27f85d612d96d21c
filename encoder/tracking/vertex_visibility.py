"""Visibility of vertices of the head: by their normals and by self-occlusion."""

import numpy as np
from numpy.typing import NDArray

from shared_model.geometry import matrix_from_quaternion
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
Mask = NDArray[np.bool_]

# Skin at more than 70 degrees to the line of sight is too foreshortened to be tracked.
_MIN_COSINE = 0.34
# Skin less than this in front of a point does not occlude it.
_CLEARANCE_MM = 2.0
_CELL_DEG = 5.0


class VertexVisibility:
    """Visibility of a few vertices of one mesh from any direction.

    Self-occlusion is tabulated in cells of `_CELL_DEG`, each computed at its first use.
    vertices: (n, 3) float64, mm, head frame.  triangles: (m, 3).  index: (k,) of the few vertices.
    """

    def __init__(self, vertices: Array, triangles: Indices, index: Indices) -> None:
        self._vertices, self._triangles, self._index = vertices, triangles, index
        self._normals = vertex_normals(vertices, triangles)[index]
        self._adjacent = (triangles[None] == index[:, None, None]).any(axis=2)
        self._cells: dict[tuple[int, int], Mask] = {}

    def visible(self, pose: Pose) -> Mask:
        """(k,) whether the camera sees each vertex at this pose of the head."""
        camera_mm = -matrix_from_quaternion(pose.rotation).T @ pose.translation_mm
        direction = camera_mm / np.linalg.norm(camera_mm)
        facing = self._normals @ direction > _MIN_COSINE
        yaw = np.degrees(np.arctan2(direction[0], direction[2]))
        pitch = np.degrees(np.arcsin(np.clip(direction[1], -1, 1)))
        cell = round(yaw / _CELL_DEG), round(pitch / _CELL_DEG)
        if cell not in self._cells:
            self._cells[cell] = self._unoccluded(*np.radians(np.array(cell) * _CELL_DEG))
        return np.asarray(facing & self._cells[cell])

    def _unoccluded(self, yaw: float, pitch: float) -> Mask:
        """(k,) whether no triangle lies between a vertex and a far camera in this direction."""
        direction = np.array(
            [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)]
        )
        right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
        axes = np.column_stack([right, np.cross(direction, right), direction])
        rotated = self._vertices @ axes
        corners, points = rotated[self._triangles], rotated[self._index]
        # Barycentric coordinates of every point in every triangle, projected along the direction.
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        area = _cross(b - a, c - a)
        degenerate = np.abs(area) < 1e-9
        area = np.where(degenerate, 1.0, area)
        offset = points[:, None] - a[None]
        v = _cross(offset, (c - a)[None]) / area
        w = _cross((b - a)[None], offset) / area
        depth = a[:, 2] + v * (b - a)[:, 2] + w * (c - a)[:, 2]
        in_front = depth > points[:, None, 2] + _CLEARANCE_MM
        hit = (v >= 0) & (w >= 0) & (v + w <= 1) & in_front & ~degenerate & ~self._adjacent
        return np.asarray(~hit.any(axis=1))


def _cross(p: Array, q: Array) -> Array:
    """Cross product of the first two coordinates."""
    return np.asarray(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])
