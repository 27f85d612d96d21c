"""Operations on plain images."""

import cv2
import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]


def hull_mask(points: NDArray[np.floating], shape: tuple[int, int]) -> Single:
    """(h, w) 1 within the convex hull of points (n, 2), pixels, else 0."""
    mask = np.zeros(shape, np.float32)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(points).astype(np.int32)), 1.0)
    return mask
