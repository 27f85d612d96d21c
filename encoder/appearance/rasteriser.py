"""What is nearest to the camera under each pixel: triangles drawn without a graphics card."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.integer]

# Triangles of less than this twice their area, pixels, are seen from their edge.
LEAST_AREA_PX2 = 1e-9
# A pixel so little beside a triangle is in it.
EDGE = 1e-9


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
        return _spread(values, self.corners, self.weights)

    def of(self, chosen: NDArray[np.bool_]) -> "Surface":
        """Only some of the pixels."""
        return Surface(self.pixels[chosen], self.corners[:, chosen], self.weights[:, chosen])


@compiled
def _spread(
    values: NDArray[np.float32], corners: Indices, weights: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Values (d, n) of vertices at the points (p,) between them: (d, p)."""
    found = np.empty((len(values), corners.shape[1]), np.float32)
    for row in range(len(values)):
        for pixel in range(corners.shape[1]):
            found[row, pixel] = (
                values[row, corners[0, pixel]] * weights[0, pixel]
                + values[row, corners[1, pixel]] * weights[1, pixel]
                + values[row, corners[2, pixel]] * weights[2, pixel]
            )
    return found


def front_surface(
    at_px: Array, depth: Array, triangles: NDArray[np.int32], wanted: NDArray[np.bool_]
) -> Surface:
    """The front faces that the `wanted` pixels (h, w) show.

    at_px: (n, 2) vertices in the picture, y down.  depth: (n,) > 0, along the camera's axis.
    triangles: (m, 3), counter-clockwise seen from outside.
    """
    nearest = np.zeros(wanted.shape)
    owner = np.zeros(wanted.shape, np.int32)
    shares = np.zeros((3, *wanted.shape), np.float32)
    _draw(at_px, depth, triangles, wanted, nearest, owner, shares)
    shown = np.flatnonzero(nearest)
    corners = triangles.T.take(owner.ravel()[shown], axis=1)
    return Surface(shown, corners, shares.reshape(3, -1).take(shown, axis=1))


@compiled
def _draw(
    at_px: Array,
    depth: Array,
    triangles: NDArray[np.int32],
    wanted: NDArray[np.bool_],
    nearest: Array,
    owner: NDArray[np.int32],
    shares: NDArray[np.float32],
) -> None:
    """Fill in one over the depth of each pixel, whose triangle it shows, its corners' shares."""
    height, width = wanted.shape
    for number in range(len(triangles)):
        i, j, k = triangles[number]
        ax, ay = at_px[i]
        bx, by = at_px[j, 0] - ax, at_px[j, 1] - ay
        cx, cy = at_px[k, 0] - ax, at_px[k, 1] - ay
        area = bx * cy - by * cx
        if not area < -LEAST_AREA_PX2:
            continue
        left = int(max(np.ceil(ax + min(0.0, bx, cx)), 0.0))
        right = int(min(np.floor(ax + max(0.0, bx, cx)), width - 1.0))
        top = int(max(np.ceil(ay + min(0.0, by, cy)), 0.0))
        bottom = int(min(np.floor(ay + max(0.0, by, cy)), height - 1.0))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if not wanted[row, column]:
                    continue
                x, y = column - ax, row - ay
                b = (x * cy - y * cx) / area
                c = (bx * y - by * x) / area
                if b < -EDGE or c < -EDGE or b + c > 1 + EDGE:
                    continue
                # Shares in the picture become shares in space.
                near_a, near_b, near_c = (1 - b - c) / depth[i], b / depth[j], c / depth[k]
                near = near_a + near_b + near_c
                if near >= nearest[row, column]:
                    nearest[row, column] = near
                    owner[row, column] = number
                    shares[0, row, column] = near_a / near
                    shares[1, row, column] = near_b / near
                    shares[2, row, column] = near_c / near
