"""A small z-buffer: which triangle, and where on it, each pixel of a view sees."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Array, Integers
from shared_model.geometry import Camera, camera_from_head, pixel_from_camera
from shared_model.parameters import Pose


@dataclass(frozen=True, slots=True)
class Hits:
    """What each pixel sees: triangle (h, w) int64, -1 for none; weights (h, w, 3), barycentric."""

    triangle: Integers
    weights: Array


def rasterise(
    points: Array, depth: Array, triangles: NDArray[np.integer], width: int, height: int
) -> Hits:
    """Draw triangles of points (n, 2), pixels, nearest depth (n,) first."""
    buffer = np.full((height, width), np.inf)
    hits = Hits(np.full((height, width), -1, np.int64), np.zeros((height, width, 3)))
    corners, z = points[triangles], depth[triangles]
    low = np.maximum(np.ceil(corners.min(1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(1)), [width - 1, height - 1]).astype(int)
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = edge_a[:, 0] * edge_b[:, 1] - edge_a[:, 1] * edge_b[:, 0]
    for t in np.flatnonzero((high >= low).all(1) & (np.abs(area) > 1e-12)):
        v, u = np.mgrid[low[t, 1] : high[t, 1] + 1, low[t, 0] : high[t, 0] + 1]
        du, dv = u - corners[t, 0, 0], v - corners[t, 0, 1]
        wb = (du * edge_b[t, 1] - dv * edge_b[t, 0]) / area[t]
        wc = (dv * edge_a[t, 0] - du * edge_a[t, 1]) / area[t]
        w = np.stack([1 - wb - wc, wb, wc], -1)
        inverse = w / z[t]
        nearer = 1 / np.maximum(inverse.sum(-1), 1e-12)
        window = (slice(low[t, 1], high[t, 1] + 1), slice(low[t, 0], high[t, 0] + 1))
        seen = (w >= -1e-9).all(-1) & (nearer < buffer[window])
        buffer[window][seen] = nearer[seen]
        hits.triangle[window][seen] = t
        # Perspective-correct: weights on the triangle in space, not on its picture.
        hits.weights[window][seen] = (inverse * nearer[..., None])[seen]
    return hits


def view(vertices: Array, triangles: NDArray[np.integer], camera: Camera, pose: Pose) -> Hits:
    """What a camera sees of a mesh.  vertices: (n, 3), mm, head frame."""
    points = camera_from_head(pose, vertices)
    return rasterise(
        pixel_from_camera(camera, points), points[:, 2], triangles, camera.width, camera.height
    )
