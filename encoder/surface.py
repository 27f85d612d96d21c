"""What is nearest to the camera under each pixel: triangles drawn without a graphics card."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.cover import covered

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Triangles of less than this twice their area, pixels, are seen from their edge.
LEAST_AREA_PX2 = 1e-9


@dataclass(frozen=True, slots=True)
class Surface:
    """The pixels that show a surface.

    pixels: (p,) numbers in the picture, row by row, ascending.
    corners: (3, p) vertices of the triangle that each shows.
    weights: (3, p) float32, their shares in the point that it shows.
    """

    pixels: Indices
    corners: Indices
    weights: NDArray[np.float32]

    def points(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Per-vertex values (d, n) at every pixel: (d, p)."""
        shares = zip(self.corners, self.weights, strict=True)
        return np.asarray(sum(values.take(corner, axis=1) * w for corner, w in shares))

    def of(self, chosen: NDArray[np.bool_]) -> "Surface":
        """Only some of the pixels."""
        return Surface(self.pixels[chosen], self.corners[:, chosen], self.weights[:, chosen])


def front_surface(
    at_px: Array, depth: Array, triangles: NDArray[np.int32], wanted: NDArray[np.bool_]
) -> Surface:
    """The front faces that the `wanted` pixels (h, w) show.

    at_px: (n, 2) vertices in the picture, y down.  depth: (n,) > 0, along the camera's axis.
    triangles: (m, 3), counter-clockwise seen from outside.
    """
    height, width = wanted.shape
    corners_px = at_px[triangles]
    (ax, ay), (bx, by) = ((corners_px[:, i] - corners_px[:, 0]).T for i in (1, 2))
    front = np.flatnonzero(ax * by - bx * ay < -LEAST_AREA_PX2)
    triangle, columns, rows, shares = covered(corners_px[front], width, height)
    pixels = rows * width + columns
    kept = np.flatnonzero(wanted.ravel()[pixels])
    pixels, triangle = pixels[kept], front[triangle[kept]]
    # Shares in the picture become shares in space.
    near = shares[kept].T / depth[triangles].T.take(triangle, axis=1)
    nearness = near[0] + near[1] + near[2]
    nearest = np.zeros(wanted.size)
    np.maximum.at(nearest, pixels, nearness)
    first = np.flatnonzero(nearness >= nearest[pixels])
    owner = np.full(wanted.size, -1, np.intp)
    owner[pixels[first]] = first
    shown = np.flatnonzero(owner >= 0)
    owner = owner[shown]
    weights = (near.take(owner, axis=1) / nearness[owner]).astype(np.float32)
    corners = triangles[triangle[owner]].T.astype(np.intp, order="C")
    return Surface(shown, corners, weights)
