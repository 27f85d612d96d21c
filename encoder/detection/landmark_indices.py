"""Indices of landmarks in MediaPipe's 468-point face mesh.

Right and left are the subject's.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Float = TypeVar("Float", bound=np.floating[Any])

LANDMARK_COUNT = 468
# The outline of the face, in order.
FACE_OVAL = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
# Points that expressions hardly move.
RIGID_LANDMARKS = (
    *(33, 133, 362, 263, 168, 6, 197, 195, 5, 4, 1, 2, 98, 327, 129, 358, 9, 151, 234, 454, 152),
)
# Outer corners of the right and left eye.
OUTER_EYE_CORNERS = (33, 263)
# Outer and inner corner of the right eye, and of the left eye.
EYE_CORNER_PAIRS = ((33, 133), (263, 362))
# Margins of the right and left eyelids without the corners, the lower lid first, in the order of
# the iris network's contour.
EYELID_MARGINS = (
    (7, 163, 144, 145, 153, 154, 155, 246, 161, 160, 159, 158, 157, 173),
    (249, 390, 373, 374, 380, 381, 382, 466, 388, 387, 386, 385, 384, 398),
)
# Inner margin of the upper lip, and the points of the lower lip that they touch when it is closed.
INNER_LIP_PAIRS = (13, 82, 312, 81, 311), (14, 87, 317, 178, 402)
# Pairs of points whose distance measures a gesture.
LANDMARK_DISTANCES = {
    "mouth": ((13, 14),),
    "brow": ((105, 159), (334, 386)),
    "blink": ((159, 145), (386, 374)),
}


def face_outline(points: NDArray[Float]) -> NDArray[Float]:
    """(36, 2) the outline of the face, pixels, of landmarks (468, >= 2)."""
    return points[list(FACE_OVAL), :2]
