"""The square window of a picture in which a face is annotated, trained on and searched.

Its side is a fixed number of millimetres of the head, so that what depends on the size of a
picture, as the surround of retinex, is the same for faces in large and in small pictures.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from aam.weak_pose import project
from shared_model.arrays import Array, Picture

# Side of the window, mm; the window's middle relative to the head's origin, mm, head frame: the
# middle of the face.
WINDOW_MM = 300.0
FACE_CENTRE_MM = np.array([0.0, -18.0, 60.0])


@dataclass(frozen=True, slots=True)
class FaceWindow:
    """A square window of a picture, scaled.

    picture: (side, side, 3) uint8 BGR.
    corner: (2,) place of the window's upper left corner in the source, pixels (of pixel centres).
    ratio: pixels of the window per pixel of the source.
    """

    picture: Picture
    corner: Array
    ratio: float

    def to_window(self, points_px: Array) -> Array:
        """Map points (..., 2) from pixels of the source to pixels of the window."""
        return np.asarray((points_px - self.corner + 0.5) * self.ratio - 0.5)

    def to_source(self, points_px: Array) -> Array:
        """Map points (..., 2) from pixels of the window to pixels of the source."""
        return np.asarray((points_px + 0.5) / self.ratio - 0.5 + self.corner)

    def pose_to_window(self, pose: Array) -> Array:
        """A pose whose last three values are x, y, log scale, in pixels of the window."""
        return np.concatenate(
            [pose[:-3], self.to_window(pose[-3:-1]), [pose[-1] + np.log(self.ratio)]]
        )

    def pose_to_source(self, pose: Array) -> Array:
        """A pose whose last three values are x, y, log scale, in pixels of the source."""
        return np.concatenate(
            [pose[:-3], self.to_source(pose[-3:-1]), [pose[-1] - np.log(self.ratio)]]
        )


def window_around(picture: Picture, centre_px: Array, side_px: float, size: int) -> FaceWindow:
    """The window of a picture (h, w, 3) or (h, w) uint8 with this middle and side, in pixels of
    the picture, resampled to `size` pixels a side.  Beyond the picture its border is repeated.
    """
    side = max(round(side_px), 4)
    left, top = np.floor(centre_px - (side - 1) / 2 + 0.5).astype(int)
    height, width = picture.shape[:2]
    rows = np.clip(np.arange(top, top + side), 0, height - 1)
    columns = np.clip(np.arange(left, left + side), 0, width - 1)
    cut = picture[rows[:, None], columns[None]]
    method = cv2.INTER_AREA if size < side else cv2.INTER_CUBIC
    resized = np.asarray(cv2.resize(cut, (size, size), interpolation=method), np.uint8)
    if resized.ndim == 2:
        resized = np.repeat(resized[..., None], 3, axis=2)
    return FaceWindow(resized, np.array([left, top], float), size / side)


def shrunk(window: FaceWindow, size: int) -> FaceWindow:
    """The same window at `size` pixels a side, at most its own."""
    own = len(window.picture)
    if size >= own:
        return window
    picture = cv2.resize(window.picture, (size, size), interpolation=cv2.INTER_AREA)
    return FaceWindow(np.asarray(picture, np.uint8), window.corner, window.ratio * size / own)


def face_window(picture: Picture, pose: Array, largest_px: int) -> FaceWindow:
    """The window about a face of this weak-perspective pose (6,), at most `largest_px` a side.

    Faces that are smaller in the picture are not enlarged.
    """
    side = float(np.exp(pose[5]) * WINDOW_MM)
    centre = project(pose, FACE_CENTRE_MM[None])[0]
    return window_around(picture, centre, side, min(largest_px, max(round(side), 16)))
