"""Irises and eyelids: MediaPipe's iris network.

For both eyes the network takes longer than the face mesh for the whole face, but in the face mesh a
blink closes the eyelids about half as far as in reality.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from encoder.detection.landmark_indices import EYE_CORNER_PAIRS, EYELID_MARGINS
from encoder.detection.roi import RotatedRoi, crop_roi
from encoder.detection.tflite import IRIS, TfliteNetwork
from shared_model.arrays import Array, Picture, Single

INPUT_PX = 64
CONTOUR_POINTS, IRIS_POINTS = 71, 5
# Points of the contour that correspond to `EYELID_MARGINS`; 0 and 8 are the eye's corners.
_MARGIN_POINTS = (*range(1, 8), *range(9, 16))
# Side of a crop in widths of the eye: as the network was trained, and somewhat wider.  Wider crops
# separate open from closed eyes better in small or coarse pictures and behind glasses, but leave
# the margins of closed eyelids further apart.
TRAINED_CROP_SCALE, WIDE_CROP_SCALE = 2.3, 2.6


@dataclass(frozen=True, slots=True)
class EyeLandmarks:
    """The landmarks of both eyes: the subject's right eye, then the left.

    irises: (2, 5, 2) float64, pixels: centre, then four points on the rim.
    contours: (2, 71, 2) float64, pixels: eyelid margins, then the region up to the brow.
    """

    irises: Array
    contours: Array


class IrisLandmarker:
    """Runs the iris network on the eyes of a face whose face-mesh landmarks are known.

    folder: holds the .tflite files.  crop_scale: side of the crops in widths of the eye.
    Raises `NetworkFilesMissing`.
    """

    def __init__(self, folder: Path, crop_scale: float = TRAINED_CROP_SCALE) -> None:
        self._network, self._crop_scale = TfliteNetwork(folder / IRIS), crop_scale

    def find(self, frame: Picture, points: Array) -> EyeLandmarks:
        """The eyes in `frame` (h, w, 3) uint8 BGR; points: (468, 3) landmarks, pixels."""
        irises, contours = zip(*(self._find(frame, points, side) for side in range(2)), strict=True)
        return EyeLandmarks(np.array(irises), np.array(contours))

    def margins(self, frame: Picture, points: Array, side: int) -> Array:
        """(14, 2) pixels of an eye's `EYELID_MARGINS`; side: 0 is the subject's right eye."""
        return self._find(frame, points, side)[1][list(_MARGIN_POINTS)]

    def replace_eyelids(self, frame: Picture, points: Array) -> Array:
        """(468, 3) landmarks, pixels: `points` with the eyelid margins that this network finds."""
        replaced = points.copy()
        for side, margin in enumerate(EYELID_MARGINS):
            replaced[list(margin), :2] = self.margins(frame, points, side)
        return replaced

    def _find(self, frame: Picture, points: Array, side: int) -> tuple[Array, Array]:
        """The iris (5, 2) and the contour (71, 2) of an eye, see `EyeLandmarks`."""
        roi = _eye_roi(points, side, self._crop_scale)
        crop, pixel_from_crop = crop_roi(frame, roi, INPUT_PX), roi.pixel_from_crop(INPUT_PX)
        if side == 1:
            # The network was trained on the subject's right eye: the left eye is mirrored.
            crop = np.ascontiguousarray(crop[:, ::-1])
            mirror = np.array([[-1.0, 0, INPUT_PX - 1], [0, 1, 0], [0, 0, 1]])
            pixel_from_crop = pixel_from_crop @ mirror
        outputs = self._network.run(crop, low=0.0)
        iris, contour = outputs[3 * IRIS_POINTS], outputs[3 * CONTOUR_POINTS]
        return _points(iris, pixel_from_crop), _points(contour, pixel_from_crop)


def _eye_roi(points: Array, side: int, crop_scale: float) -> RotatedRoi:
    """The ROI of an eye.  side: 0 is the subject's right eye, 1 the left."""
    outer, inner = points[list(EYE_CORNER_PAIRS[side]), :2]
    along = (inner - outer) * (1 if side == 0 else -1)
    width = float(np.max(np.abs(along)))
    return RotatedRoi(
        (outer + inner) / 2, crop_scale * width, float(np.arctan2(along[1], along[0]))
    )


def _points(raw: Single, pixel_from_crop: Array) -> Array:
    """(n, 2) pixels of the frame, from a network's output (3 n,)."""
    flat = raw.astype(np.float64).reshape(-1, 3)[:, :2] - 0.5
    return np.asarray(flat @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2])
