"""Which of the face mesh's landmarks lie where."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Points of the face's outline.  They slide as the head turns, but where they are not met the
# picture shows background on the face: full weight measured better than less (carphone +0.8 dB).
OUTLINE = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
RIGID = (33, 133, 362, 263, 168, 6, 197, 195, 5, 4, 1, 2, 98, 327, 129, 358, 9, 151, 234, 454, 152)


# Outer corners of the subject's right and left eye among the landmarks.
EYE_CORNERS = (33, 263)


COUNT = 468


# Landmarks at the corners of the subject's right and left eye: outer, inner.
CORNERS = ((33, 133), (263, 362))
# Landmarks on the margins of the subject's right and left lids, the lower ones first, as they stand
# at the beginning of a contour; the corners, at 0 and 8 there, the mesh knows as well.
LIDS = (
    (7, 163, 144, 145, 153, 154, 155, 246, 161, 160, 159, 158, 157, 173),
    (249, 390, 373, 374, 380, 381, 382, 466, 388, 387, 386, 385, 384, 398),
)


# The landmark network's points along the inner margins of the lips, upper and lower that meet.
MARGINS = (13, 82, 312, 81, 311), (14, 87, 317, 178, 402)


# Pairs of landmarks whose distance is a gesture, those of the lids by the iris network.
GAPS = {
    "mouth": ((13, 14),),
    "brow": ((105, 159), (334, 386)),
    "blink": ((159, 145), (386, 374)),
}


def outline_of(points: Array) -> Array:
    """(n, 2) the face's outline among landmarks (468, >= 2)."""
    return points[list(OUTLINE), :2]
