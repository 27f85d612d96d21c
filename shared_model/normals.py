"""Normals of a triangle mesh."""

import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Array


def vertex_normals(vertices: Array, triangles: NDArray[np.integer]) -> Array:
    """(n, 3) unit outward normals, the area-weighted mean of each vertex' triangles.

    vertices: (n, 3) float64, any frame and unit.
    triangles: (m, 3), counter-clockwise seen from outside.
    """
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    flat = np.cross(b - a, c - a)
    corners = triangles.T.ravel()
    sums = [np.bincount(corners, np.tile(flat[:, k], 3), len(vertices)) for k in range(3)]
    normals = np.stack(sums, axis=-1)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))
