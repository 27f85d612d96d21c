"""Operations on images of any content."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Picture, Single

# Of pictures that are shown and soon replaced.
JPEG_QUALITY = 90


def hull_mask(points_px: NDArray[np.floating], shape: tuple[int, int]) -> Single:
    """(h, w) float32: 1 within the convex hull of points (n, 2), pixels, else 0.

    shape: (h, w) of the mask.
    """
    mask = np.zeros(shape, np.float32)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(points_px).astype(np.int32)), 1.0)
    return mask


def sample_bicubic(image: NDArray[Any], positions_px: NDArray[Any]) -> Single:
    """(k, channels) float32: an image (h, w) or (h, w, channels) at positions (k, 2), pixels.

    Positions beyond the image sample its border.
    """
    # OpenCV's images have fewer than 32768 rows and columns.
    columns = 1024
    rows = -(-len(positions_px) // columns)
    grid = np.zeros((2, rows * columns), dtype=np.float32)
    grid[:, : len(positions_px)] = positions_px.T
    u, v = grid.reshape(2, rows, columns)
    sampled = cv2.remap(image, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    channels = 1 if image.ndim == 2 else image.shape[2]
    flat = sampled.reshape(rows * columns, channels)[: len(positions_px)]
    return np.asarray(flat, dtype=np.float32)


def blurred(image: Single, sigma_px: float) -> Single:
    """An image (h, w) or (h, w, channels) blurred by a Gaussian."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def jpeg(picture: Picture, quality: int = JPEG_QUALITY) -> bytes:
    """A picture (h, w, 3) uint8 BGR as a JPEG file.  quality: 0 to 100."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return data.tobytes()
