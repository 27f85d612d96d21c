"""A z-buffer rasteriser: the triangle nearest to the camera in each pixel, without a GPU."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.jit import jit
from shared_model.arrays import Array, Mask, Single, VertexIndices

Indices = NDArray[np.integer]

# Triangles with less than twice this area in the picture, pixels^2, are seen edge-on.
MIN_DOUBLE_AREA_PX2 = 1e-9
# A pixel whose barycentric coordinates are outside by no more than this is in the triangle.
EDGE_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Fragments:
    """The pixels that a surface covers.

    pixels: (p,) row-major indices in the picture, ascending.
    corners: (3, p) vertices of the triangle in each pixel.
    weights: (3, p) float32, barycentric coordinates in space of the point in each pixel.
    """

    pixels: Indices
    corners: Indices
    weights: Single

    def interpolate(self, values: Single) -> Single:
        """(d, p) the values of vertices (d, n), interpolated at every pixel."""
        return _interpolate(values, self.corners, self.weights)

    def select(self, chosen: Mask) -> "Fragments":
        """The fragments that are chosen (p,)."""
        return Fragments(self.pixels[chosen], self.corners[:, chosen], self.weights[:, chosen])


@jit
def _interpolate(values: Single, corners: Indices, weights: Single) -> Single:
    """See `Fragments.interpolate`."""
    interpolated = np.empty((len(values), corners.shape[1]), np.float32)
    for row in range(len(values)):
        for pixel in range(corners.shape[1]):
            interpolated[row, pixel] = (
                values[row, corners[0, pixel]] * weights[0, pixel]
                + values[row, corners[1, pixel]] * weights[1, pixel]
                + values[row, corners[2, pixel]] * weights[2, pixel]
            )
    return interpolated


def rasterise(points_px: Array, depth: Array, triangles: VertexIndices, mask: Mask) -> Fragments:
    """The nearest front-facing triangle in each pixel of a mask (h, w).

    points_px: (n, 2) vertices in the picture, y down.  depth: (n,) > 0, along the camera's axis.
    triangles: (m, 3), counter-clockwise seen from outside.
    """
    inverse_depth = np.zeros(mask.shape)
    triangle = np.zeros(mask.shape, np.int32)
    weights = np.zeros((3, *mask.shape), np.float32)
    _rasterise(points_px, depth, triangles, mask, inverse_depth, triangle, weights)
    covered = np.flatnonzero(inverse_depth)
    corners = triangles.T.take(triangle.ravel()[covered], axis=1)
    return Fragments(covered, corners, weights.reshape(3, -1).take(covered, axis=1))


@jit
def _rasterise(
    points_px: Array,
    depth: Array,
    triangles: VertexIndices,
    mask: Mask,
    inverse_depth: Array,
    triangle: VertexIndices,
    weights: Single,
) -> None:
    """Write the inverse depth, the triangle's index (h, w) and the weights (3, h, w) of pixels."""
    height, width = mask.shape
    for number in range(len(triangles)):
        i, j, k = triangles[number]
        ax, ay = points_px[i]
        bx, by = points_px[j, 0] - ax, points_px[j, 1] - ay
        cx, cy = points_px[k, 0] - ax, points_px[k, 1] - ay
        area = bx * cy - by * cx
        if not area < -MIN_DOUBLE_AREA_PX2:
            continue
        left = int(max(np.ceil(ax + min(0.0, bx, cx)), 0.0))
        right = int(min(np.floor(ax + max(0.0, bx, cx)), width - 1.0))
        top = int(max(np.ceil(ay + min(0.0, by, cy)), 0.0))
        bottom = int(min(np.floor(ay + max(0.0, by, cy)), height - 1.0))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if not mask[row, column]:
                    continue
                x, y = column - ax, row - ay
                b, c = (x * cy - y * cx) / area, (bx * y - by * x) / area
                if b < -EDGE_TOLERANCE or c < -EDGE_TOLERANCE or b + c > 1 + EDGE_TOLERANCE:
                    continue
                # Perspective-correct: coordinates in the picture become coordinates in space.
                near_a, near_b, near_c = (1 - b - c) / depth[i], b / depth[j], c / depth[k]
                near = near_a + near_b + near_c
                if near >= inverse_depth[row, column]:
                    inverse_depth[row, column] = near
                    triangle[row, column] = number
                    weights[0, row, column] = near_a / near
                    weights[1, row, column] = near_b / near
                    weights[2, row, column] = near_c / near
