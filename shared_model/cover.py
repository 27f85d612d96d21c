"""Which points of a grid lie in which triangles: texels of an atlas, pixels of a picture."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Grid points that are tried against triangles at once.
POINTS_AT_ONCE = 1 << 19


def covered(corners: Array, width: int, height: int) -> tuple[Indices, Indices, Indices, Array]:
    """The grid points (column, row) in each of some triangles.

    corners: (n, 3, 2).  Flat triangles cover nothing; a point on an edge is in both triangles.
    Returns (m,) numbers of triangles, columns, rows, and (m, 3) barycentric weights.
    """
    low = np.maximum(np.ceil(corners.min(1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(1)), [width - 1, height - 1]).astype(int)
    side = np.where((high < low).any(1), 0, (high - low).max(1) + 1)
    # Triangles of about the same size together, as many as make small arrays.
    found = [(np.zeros(0, np.intp),) * 3 + (np.zeros((0, 3)),)]
    for least in (2**power for power in range(max(width, height).bit_length() + 1)):
        group = np.flatnonzero((side > least // 2) & (side <= least))
        for part in np.array_split(group, 1 + len(group) * least**2 // POINTS_AT_ONCE):
            found.append(_inside(part, corners[part], low[part], high[part], least))
    triangle, x, y, shares = (np.concatenate(values) for values in zip(*found, strict=True))
    return triangle, x, y, shares


def _inside(
    index: Indices, corners: Array, low: Indices, high: Indices, side: int
) -> tuple[Indices, Indices, Indices, Array]:
    """The grid points in each of some triangles: its index, column, row, barycentric weights.

    corners: (n, 3, 2).  low, high: (n, 2) first and last point, less than `side` apart.
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
