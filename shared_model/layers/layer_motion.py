"""How the layer of the person moves by itself: shoulders and hair that do not follow the head.

Motion fields are coarse displacements over the picture of the person, interpolated linearly at the
points of the mesh of `head_motion`.  A frame has a coefficient for each field.
"""

import numpy as np

from shared_model.arrays import Array
from shared_model.layers.head_motion import BackgroundMesh

# Mesh cells along the edges of the picture over which inward motion falls to 0.
EDGE_CELLS = 2.0


def fields_at_mesh(mesh: BackgroundMesh, fields_px: Array) -> Array:
    """(k, rows, columns, 2) pixels: motion fields at the points of a mesh.

    fields_px: (k, h, w, 2) pixels of displacement per unit, at points evenly over the picture,
        corner to corner.
    """
    rows, columns = mesh.grid_px.shape[:2]
    down, across = (
        interpolation_matrix(*ends)
        for ends in zip((rows, columns), fields_px.shape[1:3], strict=True)
    )
    return np.asarray(np.einsum("yi,kijd,xj->kyxd", down, fields_px, across, optimize=True))


def own_motion(fields: Array, coefficients: Array) -> Array:
    """(rows, columns, 2) pixels: what the fields (k, rows, columns, 2) add to the motion of a mesh.

    coefficients: of the fields first; missing ones are 0.
    Inward motion fades at the edges of the picture, which must not come away from them.
    """
    used = coefficients[: len(fields)]
    motion = np.tensordot(used, fields[: len(used)], 1)
    inward = _from_edges(motion.shape[0]), _from_edges(motion.shape[1])
    for axis, (before, after) in ((0, inward[1]), (1, inward[0])):
        shape = (1, -1) if axis == 0 else (-1, 1)
        part = motion[..., axis]
        kept = np.maximum(part, 0) * before.reshape(shape)
        motion[..., axis] = kept + np.minimum(part, 0) * after.reshape(shape)
    return np.asarray(motion)


def interpolation_matrix(count: int, points: int) -> Array:
    """(count, points) weights of linear interpolation between evenly spaced points, end to end."""
    at = np.linspace(0, points - 1, count)
    return np.asarray(np.maximum(1 - np.abs(at[:, None] - np.arange(points)), 0))


def _from_edges(count: int) -> tuple[Array, Array]:
    """(count,) 0 at the first edge, rising to 1; and the same at the last edge."""
    rising = np.minimum(np.arange(count) / EDGE_CELLS, 1)
    return rising, rising[::-1]
