"""The shape-free frames of the model (thesis 2.4.2, Fig. 2.16 and 3.5): full face, inside of it,
and without the forehead, as a 2D AAM of 68 landmarks has it.
"""

from functools import lru_cache

import numpy as np

from encoder.detection.landmark_indices import FACE_OVAL
from runtime.image_ops import hull_mask
from shared_model.appearance import Atlas, atlas_of
from shared_model.mesh import PARTS, generic_head

# Convex hull of the inside-face frame: above the brows, beside the eyes, below the lower lip.
_INSIDE = (
    *(63, 105, 66, 107, 336, 296, 334, 293, 70, 300),
    *(35, 265, 111, 340, 50, 280, 207, 427, 212, 432, 194, 418, 200),
)
# Jaw and brows of iBUG's scheme, whose other landmarks they enclose.
_JAW_AND_BROWS = (
    *(162, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 389),
    *(70, 63, 105, 66, 107, 336, 296, 334, 293, 300),
)
# The convex hulls of these landmarks, by frame.
_OUTLINES = {"full": FACE_OVAL, "inside": _INSIDE, "landmarks": _JAW_AND_BROWS}
FRAMES = tuple(_OUTLINES)
_PARTS = ("skin", "eye_left", "eye_right")


@lru_cache(maxsize=8)
def texture_frame(size: int, frame: str) -> Atlas:
    """The texels of a frame: skin and eyes of the generic head's atlas within the frame's outline.

    size: texels a side of the whole atlas.  frame: one of `FRAMES`.
    """
    if frame not in FRAMES:
        raise ValueError(f"frame is {frame!r}, expected one of {FRAMES}")
    head = generic_head()
    atlas = atlas_of(head, size)
    outline = list(_OUTLINES[frame])
    corners = head.triangles[head.network_triangles[outline]]
    points = np.einsum(
        "mc,mcd->md", head.network_weights[outline], head.texture_coordinates[corners]
    )
    mask = hull_mask(points * size - 0.5, (size, size))
    parts = [PARTS.index(name) for name in _PARTS]
    chosen = np.isin(head.parts[atlas.corners[:, 0]], parts)
    chosen &= mask[atlas.rows, atlas.columns] > 0
    return Atlas(
        size,
        atlas.rows[chosen],
        atlas.columns[chosen],
        atlas.corners[chosen],
        atlas.weights[chosen],
    )
