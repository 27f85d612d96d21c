"""The grid points inside triangles: texels of an atlas, pixels of a picture."""

from itertools import pairwise

import numpy as np

from shared_model.arrays import Array, Indices

# Grid points that are tested at once, in arrays that fit into a cache.
POINTS_AT_ONCE = 1 << 14


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
