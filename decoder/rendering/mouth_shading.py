"""Light inside the mouth, for textures that do not include it."""

import numpy as np

from shared_model.arrays import Array
from shared_model.layers.head_motion import smoothstep
from shared_model.mesh import Head

# Light inside the mouth when the lips are closed; at this distance of the lips it is 1.
CLOSED_MOUTH_LIGHT = 0.35
OPEN_MOUTH_MM = 12.0


def mouth_shading(head: Head, vertices: Array) -> float:
    """Light inside the mouth, relative to that of wide open lips.

    vertices: (n, 3) float64, mm, head frame.
    """
    upper, lower = (vertices[head.landmarks[lip]] for lip in ("sto_upper", "sto_lower"))
    opening = smoothstep(np.linalg.norm(upper - lower) / OPEN_MOUTH_MM)
    return float(CLOSED_MOUTH_LIGHT + (1 - CLOSED_MOUTH_LIGHT) * opening)
