"""Visibility of vertices of the head: by their normals and by self-occlusion."""

import numpy as np

from encoder.appearance.rasteriser import rasterise
from shared_model.arrays import Array, Mask, VertexIndices
from shared_model.geometry import matrix_from_quaternion
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

# Skin at more than 70 degrees to the line of sight is too foreshortened to be tracked.
_MIN_COSINE = 0.34
# Skin less than this in front of a point does not occlude it.
_CLEARANCE_MM = 2.0
_CELL_DEG = 5.0
# Occlusion is looked up in a depth image of the head with pixels of this size, seen from so far.
_PIXEL_MM, _FAR_MM = 0.5, 1e5


class VertexVisibility:
    """Visibility of a few vertices of one mesh from any direction.

    Self-occlusion is tabulated in cells of `_CELL_DEG`, each computed at its first use.
    vertices: (n, 3) float64, mm, head frame.  triangles: (m, 3).  index: (k,) of the few vertices.
    """

    def __init__(self, vertices: Array, triangles: VertexIndices, index: VertexIndices) -> None:
        self._vertices, self._triangles, self._index = vertices, triangles, index
        self._normals = vertex_normals(vertices, triangles)[index]
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
        down = -np.cross(direction, right)
        columns_rows = self._vertices @ np.column_stack([right, down]) / _PIXEL_MM
        columns_rows -= columns_rows.min(0)
        depth = _FAR_MM - self._vertices @ direction
        width, height = np.ceil(columns_rows.max(0)).astype(int) + 1
        fragments = rasterise(
            columns_rows, depth, self._triangles, np.ones((height, width), np.bool_)
        )
        nearest = np.full(height * width, np.inf)
        nearest[fragments.pixels] = (fragments.weights * depth[fragments.corners]).sum(0)
        column, row = np.rint(columns_rows[self._index]).astype(int).T
        return np.asarray(depth[self._index] < nearest[row * width + column] + _CLEARANCE_MM)
