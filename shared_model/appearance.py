"""The shape-free frame (thesis 2.4.2): the point of the head at each texel of the atlas.

And what makes whole pictures of it: unknown texels are filled from their surroundings.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from shared_model.arrays import Array, Indices, Mask, Single, VertexIndices
from shared_model.mesh import Head

# Shares of the nearer and the farther pixel in an image of twice the resolution.
NEAR, FAR = np.float32(0.75), np.float32(0.25)
# Grid points that are tested at once, in arrays that fit into a cache.
POINTS_AT_ONCE = 1 << 14


@dataclass(frozen=True, slots=True)
class Atlas:
    """A square texture of `size` texels a side; texel (row i, column j) has its centre at
    u = (j + 0.5) / size, v = (i + 0.5) / size.

    rows, columns: (k,) int32, the texels that lie on the mesh.
    corners: (k, 3) int32, the vertices of the triangle under each.
    weights: (k, 3) float64, barycentric weights of those vertices.
    """

    size: int
    rows: VertexIndices
    columns: VertexIndices
    corners: VertexIndices
    weights: Array

    def points(self, vertices: Array) -> Array:
        """Interpolate per-vertex values (n, d) at every texel: (k, d)."""
        gathered = vertices[self.corners]
        return np.asarray(np.einsum("kc,kcd->kd", self.weights, gathered))

    def subset(self, kept: Mask) -> "Atlas":
        """An atlas of the same size with the texels `kept` (k,) alone."""
        at = self.rows[kept], self.columns[kept]
        return Atlas(self.size, *at, self.corners[kept], self.weights[kept])


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


def pull_push_fill(image: Single, known: Mask) -> Single:
    """Fill the unknown pixels of an image (h, w, c) smoothly (pull-push, Gortler et al. 1996).

    Each level of the pyramid is the mean of the known pixels in boxes of 2 x 2 of the finer one;
    unknown pixels take the coarser level, interpolated bilinearly.  Zero if nothing is known.
    known: (h, w).
    """
    if known.all() or min(known.shape) <= 2:
        mean = image[known].mean(0) if known.any() else np.zeros(image.shape[2], np.float32)
        return np.where(known[..., None], image, mean).astype(np.float32)
    weight = known[..., None].astype(np.float32)
    total, coverage = _box_sums(image * weight), _box_sums(weight)
    means = np.asarray(total / np.maximum(coverage, 1), np.float32)
    coarse = pull_push_fill(means, coverage[..., 0] > 0)
    rows, columns = known.shape
    smooth = _doubled(_doubled(coarse).swapaxes(0, 1)).swapaxes(0, 1)[:rows, :columns]
    return np.where(known[..., None], image, smooth).astype(np.float32)


def filled_atlas(atlas: Atlas, colours: Single) -> Single:
    """The whole atlas (size, size, c) of texel colours (k, c), its unused texels filled."""
    image = np.zeros((atlas.size, atlas.size, colours.shape[1]), np.float32)
    known = np.zeros((atlas.size, atlas.size), bool)
    image[atlas.rows, atlas.columns] = colours
    known[atlas.rows, atlas.columns] = True
    return pull_push_fill(image, known)


def _box_sums(image: Single) -> Single:
    """Sums of 2 x 2 pixels; an odd last row or column counts alone."""
    even = np.pad(image, [*((0, side % 2) for side in image.shape[:2]), (0, 0)])
    rows = even[0::2] + even[1::2]
    return np.asarray(rows[:, 0::2] + rows[:, 1::2])


def _doubled(image: Single) -> Single:
    """Twice as many rows: bilinear, edges repeated."""
    before = np.concatenate([image[:1], image[:-1]])
    after = np.concatenate([image[1:], image[-1:]])
    doubled = np.empty((2 * len(image), *image.shape[1:]), np.float32)
    doubled[0::2], doubled[1::2] = NEAR * image + FAR * before, NEAR * image + FAR * after
    return doubled


def covered_points(
    corners: Array, width: int, height: int
) -> tuple[Indices, Indices, Indices, Array]:
    """The points of a grid (height, width) inside triangles with corners (n, 3, 2), (column, row).

    A triangle without area has none; a point on a common edge is in both triangles.
    Returns (m,) indices of triangles, columns, rows, and (m, 3) barycentric weights.
    """
    a, b, c = corners.transpose(1, 0, 2)
    least, most = (pick(a, pick(b, c)) for pick in (np.minimum, np.maximum))
    low = np.maximum(np.ceil(least), 0).astype(np.intp)
    high = np.minimum(np.floor(most), [width - 1, height - 1]).astype(np.intp)
    spans = np.maximum(high - low + 1, 0)
    ends = np.cumsum(spans.prod(1))
    total = int(ends[-1]) if len(ends) else 0
    starts = np.arange(0, max(total, 1), POINTS_AT_ONCE)
    parts = [*np.searchsorted(ends, starts, side="right").tolist(), len(corners)]
    found = [
        _inside(np.arange(first, end), corners[first:end], low[first:end], spans[first:end])
        for first, end in pairwise(parts)
    ]
    triangle, x, y, weights = (np.concatenate(values) for values in zip(*found, strict=True))
    return triangle, x, y, weights


def _inside(
    index: Indices, corners: Array, low: Indices, spans: Indices
) -> tuple[Indices, Indices, Indices, Array]:
    """The grid points inside some of the triangles: as `covered_points` returns them.

    index: (n,) of the triangles.  corners: (n, 3, 2).  low: (n, 2) first point to test.
    spans: (n, 2) numbers of columns and rows to test.
    """
    a, b, c = corners.transpose(1, 2, 0)
    (bx, by), (cx, cy) = b - a, c - a
    area = bx * cy - by * cx
    points = np.where(np.abs(area) < 1e-12, 0, spans.prod(1))
    which = np.repeat(np.arange(len(index)), points)
    offset = np.arange(len(which)) - np.repeat(np.cumsum(points) - points, points)
    row, column = np.divmod(offset, spans[which, 0])
    x, y = column + low[which, 0], row + low[which, 1]
    ax, ay = x - a[0].take(which), y - a[1].take(which)
    bx, by, cx, cy, area = (each.take(which) for each in (bx, by, cx, cy, area))
    wb = (ax * cy - ay * cx) / area
    wc = (bx * ay - by * ax) / area
    inside = np.flatnonzero((wb >= -1e-9) & (wc >= -1e-9) & (wb + wc <= 1 + 1e-9))
    wb, wc = wb[inside], wc[inside]
    weights = np.stack([1 - wb - wc, wb, wc], axis=-1)
    return index[which[inside]], x[inside], y[inside], weights
