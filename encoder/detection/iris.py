"""Irises and lids by MediaPipe's iris network.

The network takes longer for two eyes than the face mesh for the whole face, but the mesh's lids
close about half as far as the caller's.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import CORNERS, LIDS
from encoder.detection.roi import Square, cut_out
from encoder.detection.tflite import IRIS, Network

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 64
CONTOUR, IRIS_POINTS = 71, 5
_ON_CONTOUR = (*range(1, 8), *range(9, 16))
# The network was trained on crops this many times an eye's width; somewhat wider ones tell open
# from closed better in hard pictures (small and coarse ones, glasses), but closed margins stay
# further apart in them.
TRAINED_CROP, WIDER_CROP = 2.3, 2.6


@dataclass(frozen=True, slots=True)
class Eyes:
    """Both eyes of a face in a picture: the subject's right, then the left.

    irises: (2, 5, 2) float64, pixels: centre, then four points on the rim.
    contours: (2, 71, 2) float64, pixels: lids first, then what surrounds them up to the brow.
    """

    irises: Array
    contours: Array


class IrisFinder:
    """The iris network on the two eyes of a face whose landmarks are known.

    folder: where the .tflite files are.  Raises NetworkFilesMissing where this one is not.
    crop: how wide it looks, in widths of an eye.
    """

    def __init__(self, folder: Path, crop: float = TRAINED_CROP) -> None:
        self._network, self._crop = Network(folder / IRIS), crop

    def find(self, frame: Frame, points: Array) -> Eyes:
        """Eyes in `frame` (h, w, 3) uint8 BGR; points: (468, 3) landmarks, pixels."""
        squares = [_eye_square(points, side, self._crop) for side in range(2)]
        crops = [cut_out(frame, square, INPUT_PX) for square in squares]
        maps = [square.pixel_from_crop(INPUT_PX) for square in squares]
        # The network knows the eye on the picture's left: show it the other one mirrored.
        crops[1] = np.ascontiguousarray(crops[1][:, ::-1])
        maps[1] = maps[1] @ np.array([[-1.0, 0, INPUT_PX - 1], [0, 1, 0], [0, 0, 1]])
        outputs = self._network.run_all(crops, low=0.0)
        irises, contours = (
            np.array([_points(raw, back) for raw, back in zip(rows, maps, strict=True)])
            for rows in (outputs[3 * IRIS_POINTS], outputs[3 * CONTOUR])
        )
        return Eyes(irises, contours)

    def with_lids(self, frame: Frame, points: Array) -> Array:
        """(468, 3) landmarks, pixels, with the margins of the lids where this network sees them."""
        better = points.copy()
        for lids, contour in zip(LIDS, self.find(frame, points).contours, strict=True):
            better[list(lids), :2] = contour[list(_ON_CONTOUR)]
        return better


def _eye_square(points: Array, side: int, crop: float) -> Square:
    outer, inner = points[list(CORNERS[side]), :2]
    along = (inner - outer) * (1 if side == 0 else -1)
    reach = float(np.max(np.abs(along)))
    return Square((outer + inner) / 2, crop * reach, float(np.arctan2(along[1], along[0])))


def _points(raw: NDArray[np.float32], pixel_from_crop: Array) -> Array:
    flat = raw.astype(np.float64).reshape(-1, 3)[:, :2] - 0.5
    return np.asarray(flat @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2])
