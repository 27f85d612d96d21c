"""Where the face is in a drawn picture."""

import cv2
import numpy as np

from shared_model.arrays import Array, Single
from shared_model.geometry import Camera, pixel_from_head
from shared_model.mesh import PARTS, Head
from shared_model.parameters import Pose

# Skin that is more opaque than this is of the face.
FACE_OPACITY = 0.5
# The area is averaged over a square: its side is 1 more than twice this share of the picture's.
SOFT_SHARE = 1 / 320


def face_area(head: Head, camera: Camera, pose: Pose, vertices: Array) -> Single:
    """(height, width) 1 in the convex hull of the face's skin, 0 outside, in between at its edge.

    vertices: (n, 3) mm, head frame.
    """
    is_face = (head.opacity >= FACE_OPACITY) & (head.parts == PARTS.index("skin"))
    points = pixel_from_head(camera, pose, vertices[is_face])
    corners = cv2.convexHull(np.rint(np.clip(points, -1e4, 1e4)).astype(np.int32))
    area = np.zeros((camera.height, camera.width), np.float32)
    cv2.fillConvexPoly(area, corners, 1.0)
    side = 2 * max(1, round(SOFT_SHARE * max(area.shape))) + 1
    return np.asarray(cv2.blur(area, (side, side)), np.float32)
