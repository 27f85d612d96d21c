"""The shape-free frame (thesis 2.4.2): which point of the head each texel of the atlas shows."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shared_model.mesh import Head

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Texels that are tried against triangles at once.
TEXELS_AT_ONCE = 1 << 19


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
    """Find the triangle and barycentric weights under the centre of every texel that is shown."""
    owner = np.full((size, size), -1, dtype=np.int32)
    weights = np.zeros((size, size, 3))
    at = head.texture_coordinates * size - 0.5
    # Triangles that are never shown may lie anywhere in the chart.
    shown = np.flatnonzero(head.opacity[head.triangles].max(1) > 0)
    corners = at[head.triangles[shown]]
    low = np.maximum(np.ceil(corners.min(1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(1)), size - 1).astype(int)
    side = (high - low).max(1) + 1
    # Triangles of about the same size together, as many as make small arrays.
    found = []
    for least in (2**power for power in range(size.bit_length() + 1)):
        group = np.flatnonzero((side > least // 2) & (side <= least))
        for part in np.array_split(group, 1 + len(group) * least**2 // TEXELS_AT_ONCE):
            found.append(_inside(part, corners[part], low[part], high[part], least))
    triangle, x, y, shares = (np.concatenate(values) for values in zip(*found, strict=True))
    # Where triangles meet the last one has the texel.
    turn = np.argsort(triangle, kind="stable")
    owner[y[turn], x[turn]] = shown[triangle[turn]]
    weights[y[turn], x[turn]] = shares[turn]
    rows, columns = np.nonzero(owner >= 0)
    return Atlas(
        size,
        rows.astype(np.int32),
        columns.astype(np.int32),
        head.triangles[owner[rows, columns]],
        weights[rows, columns],
    )


def _inside(
    index: Indices, corners: Array, low: Indices, high: Indices, side: int
) -> tuple[Indices, Indices, Indices, Array]:
    """The texels in each of some triangles: its index, column, row, barycentric weights.

    corners: (n, 3, 2).  low, high: (n, 2) first and last texel, less than `side` apart.
    """
    reach = np.arange(side)
    x, y = (low[:, i, None, None] + (reach[:, None] if i else reach) for i in (0, 1))
    x, y = np.broadcast_arrays(x, y)
    (ax, ay), (bx, by), (cx, cy) = corners.transpose(1, 2, 0)[..., None, None]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    flat = np.abs(area) < 1e-12
    area = np.where(flat, 1.0, area)
    wb = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    inside = (wb >= -1e-9) & (wc >= -1e-9) & (wb + wc <= 1 + 1e-9) & ~flat
    inside &= (x <= high[:, 0, None, None]) & (y <= high[:, 1, None, None])
    shares = np.stack([1 - wb - wc, wb, wc], axis=-1)[inside]
    return index[np.nonzero(inside)[0]], x[inside], y[inside], shares


def resized(image: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """A square image (s, s, channels) at `size` texels a side, bilinear, edges repeated.

    Both ends enlarge modes with it, so that they agree to the last bit.
    """
    if len(image) == size:
        return image
    at = np.clip((np.arange(size) + 0.5) * len(image) / size - 0.5, 0, len(image) - 1)
    low = np.minimum(at.astype(int), len(image) - 2)
    share = (at - low).astype(np.float32)[:, None, None]
    rows = image[low] * (1 - share) + image[low + 1] * share
    across = share.transpose(1, 0, 2)
    return np.asarray(rows[:, low] * (1 - across) + rows[:, low + 1] * across, np.float32)
