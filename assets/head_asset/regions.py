"""How much each place of the head matters: what is shown, how densely, how dense its texture is."""

import numpy as np

from assets.head_asset.mesh_parts import SKIN, Mesh
from shared_model.arrays import Array, Integers

# Over how many mm beyond the face's outline the opacity falls to 0.
FEATHER_MM = 24.0


def smoothstep(x: Array, low: float, high: float) -> Array:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def beyond_outline(vertices: Array) -> Array:
    """(n,) mm, about how far a place lies outside the face: above, behind or below it."""
    x, y, z = vertices.T
    # The outline: an arch over the forehead that comes down in front of the ears to the jaw.
    above = np.maximum(y - (64.0 - 0.004 * x**2), 0)
    # Steeper towards the ears: opaque cheeks end some 15 mm before them.
    behind = 1.4 * np.maximum(28.0 + 0.25 * np.maximum(-y - 20, 0) - z, 0)
    jaw_edge = np.interp(z, [10, 40, 66, 80], [-42, -72, -91, -97])
    below = np.maximum(jaw_edge - y, 0)
    return np.asarray(np.sqrt(above**2 + behind**2 + below**2))


def opacity(mesh: Mesh, chart: Integers) -> Array:
    """(n,) 1 over the face, falling to 0 towards hair, ears and neck; 1 on all but skin.

    chart: (m, 3) the triangles of skin with texels; it is 0 beyond them and where they end.
    """
    value = 1 - smoothstep(beyond_outline(mesh.vertices), 0, FEATHER_MM)
    hidden = np.setdiff1d(np.flatnonzero(mesh.parts == SKIN), chart)
    ends = {tuple(place) for place in mesh.vertices[hidden].tolist()}
    value[[tuple(place) in ends for place in mesh.vertices.tolist()]] = 0.0
    return np.where(mesh.parts == SKIN, value, 1.0)


def feature_closeness(vertices: Array) -> Array:
    """(n,) 1 at eyes and mouth, falling to 0 some 15 mm around them."""
    x, y, z = vertices.T
    eye = np.sqrt(((np.abs(x) - 31) / 22) ** 2 + ((y - 17.5) / 13) ** 2)
    mouth = np.sqrt((x / 32) ** 2 + ((y + 51) / 17) ** 2)
    near = np.maximum(1 - smoothstep(eye, 0.8, 1.6), 1 - smoothstep(mouth, 0.8, 1.5))
    return np.asarray(near * smoothstep(z, 30, 50))


def importance(mesh: Mesh) -> Array:
    """(n,) weight of geometric error: features, then the face, hardly anything behind it."""
    x, y, z = mesh.vertices.T
    nose = np.exp(-((x / 22) ** 2 + ((y + 18) / 25) ** 2)) * smoothstep(z, 60, 80)
    brow = np.exp(-(((y - 37) / 8) ** 2)) * smoothstep(z, 55, 70)
    out = smoothstep(beyond_outline(mesh.vertices), 0.5 * FEATHER_MM, 1.6 * FEATHER_MM)
    face = 1 + 30 * feature_closeness(mesh.vertices) + 4 * nose + 3 * brow
    return np.asarray(face * (1 - out) + 0.01 * out)
