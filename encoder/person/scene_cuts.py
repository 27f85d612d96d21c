"""Cuts of a film: pictures that have nothing to do with those before."""

import cv2
import numpy as np

from shared_model.arrays import Picture, Single

SIDE_PX = 32
# Pixels that are averaged along a side of each of these, of a large picture.
SAMPLES = 4
# Mean change of luma, levels, from one picture to the next at a cut; and in terms of the largest
# of the changes before.
MIN_CHANGE, MIN_RATIO = 18.0, 3.0
# Weight of a change in that of those before, as the next picture comes.
DECAY = 0.8


class CutDetector:
    """Tells cuts from motion, by pictures of 32 x 32 pixels."""

    def __init__(self) -> None:
        self._before: Single | None = None
        self._usual = 0.0

    def is_cut(self, picture: Picture) -> bool:
        """Whether there is a cut before this picture (h, w, 3) uint8 BGR."""
        # Some of the pixels: all of them take 2 ms of a picture of 1280x720.
        stride = max(1, min(picture.shape[:2]) // (SAMPLES * SIDE_PX))
        some = np.ascontiguousarray(picture[::stride, ::stride])
        small = cv2.resize(some, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)
        luma = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32)
        if self._before is None:
            self._before = luma
            return False
        change = float(np.abs(luma - self._before).mean())
        is_cut = change > max(MIN_CHANGE, MIN_RATIO * self._usual)
        self._before = luma
        self._usual = 0.0 if is_cut else max(DECAY * self._usual, change)
        return is_cut
