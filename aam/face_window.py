"""The window about a face whose pose is known, at least roughly."""

import numpy as np

from aam.weak_pose import project
from aam.window import FACE_CENTRE_MM, WINDOW_MM, FaceWindow, window_around
from shared_model.arrays import Array, Picture


def face_window(picture: Picture, pose: Array, largest_px: int) -> FaceWindow:
    """The window about a face of this weak-perspective pose (6,), at most `largest_px` a side.

    Faces that are smaller in the picture are not enlarged.
    """
    side = float(np.exp(pose[5]) * WINDOW_MM)
    centre = project(pose, FACE_CENTRE_MM[None])[0]
    return window_around(picture, centre, side, min(largest_px, max(round(side), 16)))
