"""Visibility of texels, by a depth buffer that the texels themselves fill.

Texels are denser than the cells of the buffer, whose size is fixed on the head, in mm.  So the
result depends neither on the size of the frame nor on the distance of the head.  The depth image
of `rasteriser`, which the visibility of vertices and of pixels is taken from, agrees on 98 to 99 of
100 texels and takes two to four times as long, in every fit of every frame.
"""

import numpy as np

from runtime.jit import jit
from shared_model import geometry
from shared_model.appearance import Atlas
from shared_model.arrays import Array, Mask, VertexIndices
from shared_model.parameters import Pose

# Least cosine between a visible texel's normal and the direction to the camera.
FACING_COSINE = 0.1
# Side of a cell of the depth buffer, mm at the head's distance.
DEPTH_CELL_MM = 1.5
# How far a visible texel may lie behind the nearest one in its cell.
DEPTH_TOLERANCE_MM = 2.0
# Half the side of the depth buffer, cells; it is centred on the head.
DEPTH_GRID_HALF = 192


def visible_texels(
    atlas: Atlas, pose: Pose, vertices: Array, cell_mm: float = DEPTH_CELL_MM
) -> Mask:
    """(k,) whether the camera sees each texel: it faces the camera and nothing occludes it.

    vertices: (n, 3) mm, head frame.
    cell_mm: side of a cell of the depth buffer, at least the distance between texels.
    """
    camera_mm = geometry.camera_from_head(pose, vertices)
    return _visible_texels(camera_mm, atlas.corners, atlas.weights, pose.translation_mm, cell_mm)


@jit
def _visible_texels(
    camera_mm: Array,
    corners: VertexIndices,
    weights: Array,
    centre_mm: Array,
    cell_mm: float,
) -> Mask:
    """See `visible_texels`.  camera_mm: (n, 3) vertices.  corners, weights: (k, 3) of the texels.
    centre_mm: (3,) the head's translation."""
    count = len(corners)
    nearest = np.full((2 * DEPTH_GRID_HALF) ** 2, np.inf)
    cells = np.zeros(count, np.int32)
    depths = np.empty(count)
    # How far behind the nearest one in its cell each texel may lie; none for texels facing away.
    slack = np.empty(count)
    centre_column = np.floor(centre_mm[0] / cell_mm)
    centre_row = np.floor(centre_mm[1] / cell_mm)
    for k in range(count):
        x, y, z, facing = _point_and_facing(camera_mm, corners, weights, k)
        depths[k] = z
        slack[k] = -np.inf
        if z > 1:
            column = np.floor(x / z * centre_mm[2] / cell_mm) - centre_column
            row = np.floor(y / z * centre_mm[2] / cell_mm) - centre_row
            # A diverged pose may put the camera inside the head: points outside the buffer share
            # its border cells.
            column = min(max(column, -DEPTH_GRID_HALF), DEPTH_GRID_HALF - 1) + DEPTH_GRID_HALF
            row = min(max(row, -DEPTH_GRID_HALF), DEPTH_GRID_HALF - 1) + DEPTH_GRID_HALF
            cells[k] = int(column) * 2 * DEPTH_GRID_HALF + int(row)
            nearest[cells[k]] = min(nearest[cells[k]], z)
            if facing > FACING_COSINE:
                # The depth of a slanted surface changes by this much within a cell.
                slant = cell_mm * np.sqrt(1 - min(facing * facing, 1.0)) / facing
                slack[k] = DEPTH_TOLERANCE_MM + slant
    visible = np.empty(count, np.bool_)
    for k in range(count):
        visible[k] = depths[k] <= nearest[cells[k]] + slack[k]
    return visible


@jit
def _point_and_facing(
    camera_mm: Array, corners: VertexIndices, weights: Array, k: int
) -> tuple[float, float, float, float]:
    """Position of texel number k, mm, camera axes, and the cosine between its normal and the
    direction to the camera."""
    a, b, c = corners[k, 0], corners[k, 1], corners[k, 2]
    ax, ay, az = camera_mm[a, 0], camera_mm[a, 1], camera_mm[a, 2]
    bx, by, bz = camera_mm[b, 0], camera_mm[b, 1], camera_mm[b, 2]
    cx, cy, cz = camera_mm[c, 0], camera_mm[c, 1], camera_mm[c, 2]
    wa, wb, wc = weights[k, 0], weights[k, 1], weights[k, 2]
    x, y = wa * ax + wb * bx + wc * cx, wa * ay + wb * by + wc * cy
    z = wa * az + wb * bz + wc * cz
    bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    lengths = np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))
    facing = -(nx * x + ny * y + nz * z) / max(lengths, 1e-12)
    return x, y, z, facing
