"""Which texels the camera sees."""

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import compiled
from shared_model import geometry
from shared_model.appearance import Atlas
from shared_model.mesh import Head
from shared_model.parameters import Pose

Array = NDArray[np.float64]
FACING_COSINE = 0.1
DEPTH_CELL_MM = 1.5
DEPTH_TOLERANCE_MM = 2.0
CELLS_ASIDE = 192


def visible_texels(
    head: Head, atlas: Atlas, pose: Pose, vertices: Array, cell_mm: float = DEPTH_CELL_MM
) -> NDArray[np.bool_]:
    """(k,) whether the camera sees each texel: facing it, and nothing nearer before it.

    vertices: (n, 3) mm, head frame.
    cell_mm: what counts as before it; no less than texels' spacing.
    """
    seen = geometry.camera_from_head(pose, vertices)
    return _visible(seen, atlas.corners, atlas.weights, pose.translation_mm, cell_mm)


@compiled
def _visible(
    seen: Array, corners: NDArray[np.int32], weights: Array, at_mm: Array, cell_mm: float
) -> NDArray[np.bool_]:
    count = len(corners)
    nearest = np.full((2 * CELLS_ASIDE) ** 2, np.inf)
    cells = np.zeros(count, np.int32)
    depths = np.empty(count)
    # How far behind what is nearest in its cell a texel may be; none turned away is seen at all.
    slack = np.empty(count)
    aside_x, aside_y = np.floor(at_mm[0] / cell_mm), np.floor(at_mm[1] / cell_mm)
    for k in range(count):
        ax, ay, az = seen[corners[k, 0]]
        bx, by, bz = seen[corners[k, 1]]
        cx, cy, cz = seen[corners[k, 2]]
        wa, wb, wc = weights[k]
        x, y = wa * ax + wb * bx + wc * cx, wa * ay + wb * by + wc * cy
        z = wa * az + wb * bz + wc * cz
        bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        lengths = np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))
        facing = -(nx * x + ny * y + nz * z) / max(lengths, 1e-12)
        depths[k] = z
        slack[k] = -np.inf
        if z > 1:
            column = np.floor(x / z * at_mm[2] / cell_mm) - aside_x
            row = np.floor(y / z * at_mm[2] / cell_mm) - aside_y
            # A pose gone astray may bring the head into the camera: what is far aside shares a
            # cell.
            column = min(max(column, -CELLS_ASIDE), CELLS_ASIDE - 1) + CELLS_ASIDE
            row = min(max(row, -CELLS_ASIDE), CELLS_ASIDE - 1) + CELLS_ASIDE
            cells[k] = int(column) * 2 * CELLS_ASIDE + int(row)
            nearest[cells[k]] = min(nearest[cells[k]], z)
            if facing > FACING_COSINE:
                # Depth changes by this much within a cell of a slanting surface.
                slant = cell_mm * np.sqrt(1 - min(facing * facing, 1.0)) / facing
                slack[k] = DEPTH_TOLERANCE_MM + slant
    found = np.empty(count, np.bool_)
    for k in range(count):
        found[k] = depths[k] <= nearest[cells[k]] + slack[k]
    return found
