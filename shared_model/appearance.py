"""The shape-free frame (thesis 2.4.2): the point of the head at each texel of the atlas."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shared_model.mesh import Head
from shared_model.triangle_coverage import covered_points

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Atlas:
    """A square texture of `size` texels a side; texel (row i, column j) has its centre at
    u = (j + 0.5) / size, v = (i + 0.5) / size.

    rows, columns: (k,) int32, the texels that lie on the mesh.
    corners: (k, 3) int32, the vertices of the triangle under each.
    weights: (k, 3) float64, barycentric weights of those vertices.
    """

    size: int
    rows: NDArray[np.int32]
    columns: NDArray[np.int32]
    corners: NDArray[np.int32]
    weights: Array

    def points(self, vertices: Array) -> Array:
        """Interpolate per-vertex values (n, d) at every texel: (k, d)."""
        gathered = vertices[self.corners]
        return np.asarray(np.einsum("kc,kcd->kd", self.weights, gathered))


@lru_cache(maxsize=8)
def atlas_of(head: Head, size: int) -> Atlas:
    """The atlas of a head at `size` texels a side; invisible triangles have no texels."""
    owner = np.full((size, size), -1, dtype=np.int32)
    weights = np.zeros((size, size, 3))
    at = head.texture_coordinates * size - 0.5
    # Invisible triangles may have any texture coordinates.
    shown = np.flatnonzero(head.opacity[head.triangles].max(1) > 0)
    triangle, x, y, barycentric = covered_points(at[head.triangles[shown]], size, size)
    # A texel on a common edge belongs to the last triangle.
    order = np.argsort(triangle, kind="stable")
    owner[y[order], x[order]] = shown[triangle[order]]
    weights[y[order], x[order]] = barycentric[order]
    rows, columns = np.nonzero(owner >= 0)
    return Atlas(
        size,
        rows.astype(np.int32),
        columns.astype(np.int32),
        head.triangles[owner[rows, columns]],
        weights[rows, columns],
    )


def resized(image: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """A square image (s, s, channels) resized to `size` texels a side: bilinear, edges repeated."""
    if len(image) == size:
        return image
    at = np.clip((np.arange(size) + 0.5) * len(image) / size - 0.5, 0, len(image) - 1)
    low = np.minimum(at.astype(int), len(image) - 2)
    fraction = (at - low).astype(np.float32)[:, None, None]
    rows = image[low] * (1 - fraction) + image[low + 1] * fraction
    across = fraction.transpose(1, 0, 2)
    return np.asarray(rows[:, low] * (1 - across) + rows[:, low + 1] * across, np.float32)
