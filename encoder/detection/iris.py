"""Irises and eyelids: MediaPipe's iris network.

For both eyes the network takes longer than the face mesh for the whole face, but in the face mesh a
blink closes the eyelids about half as far as in reality.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import EYE_CORNER_PAIRS, EYELID_MARGINS
from encoder.detection.roi import RotatedRoi, crop_roi
from encoder.detection.tflite import IRIS, TfliteNetwork

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 64
CONTOUR_POINTS, IRIS_POINTS = 71, 5
# Points of the contour that correspond to `EYELID_MARGINS`; 0 and 8 are the eye's corners.
_MARGIN_POINTS = (*range(1, 8), *range(9, 16))
# Side of a crop in widths of the eye: as the network was trained, and somewhat wider.  Wider crops
# separate open from closed eyes better in small or coarse pictures and behind glasses, but leave
# the margins of closed eyelids further apart.
TRAINED_CROP_SCALE, WIDE_CROP_SCALE = 2.3, 2.6
# Pixels of a crop from those of its mirror image.
FLIP = np.array([[-1.0, 0, INPUT_PX - 1], [0, 1, 0], [0, 0, 1]])


@dataclass(frozen=True, slots=True)
class EyeLandmarks:
    """The landmarks of both eyes: the subject's right eye, then the left.

    irises: (2, 5, 2) float64, pixels: centre, then four points on the rim.
    contours: (2, 71, 2) float64, pixels: eyelid margins, then the region up to the brow.
    """

    irises: Array
    contours: Array


@dataclass(frozen=True, slots=True)
class EyeView:
    """One eye as the network sees it: as if it were the subject's right eye.

    crop: (INPUT_PX, INPUT_PX, 3) BGR.  pixel_from_crop: (2, 3) affine map to pixels of the frame.
    """

    crop: Frame
    pixel_from_crop: Array

    def to_frame(self, points: Array) -> Array:
        """Points (n, 2) of the crop, pixels, as pixels of the frame."""
        return np.asarray(points @ self.pixel_from_crop[:, :2].T + self.pixel_from_crop[:, 2])


class IrisLandmarker:
    """Runs the iris network on the eyes of a face whose face-mesh landmarks are known.

    folder: holds the .tflite files.  crop_scale: side of the crops in widths of the eye.
    Raises `NetworkFilesMissing`.
    """

    def __init__(self, folder: Path, crop_scale: float = TRAINED_CROP_SCALE) -> None:
        self._network, self._crop_scale = TfliteNetwork(folder / IRIS), crop_scale

    def views(self, frame: Frame, points: Array) -> tuple[EyeView, EyeView]:
        """The right and the left eye in `frame` (h, w, 3) BGR; points: (468, 3), pixels."""
        right, left = (
            EyeView(crop_roi(frame, roi, INPUT_PX), roi.pixel_from_crop(INPUT_PX))
            for roi in (_eye_roi(points, side, self._crop_scale) for side in range(2))
        )
        # The network was trained on the subject's right eye: the left eye is mirrored.
        return right, EyeView(np.ascontiguousarray(left.crop[:, ::-1]), left.pixel_from_crop @ FLIP)

    def contour(self, view: EyeView) -> Array:
        """(71, 2) the contour of one eye, see `EyeLandmarks`, pixels of its crop."""
        return _points(self._network.run(view.crop, low=0.0)[3 * CONTOUR_POINTS])

    def find(self, frame: Frame, points: Array) -> EyeLandmarks:
        """The eyes in `frame` (h, w, 3) uint8 BGR; points: (468, 3) landmarks, pixels."""
        views = self.views(frame, points)
        outputs = self._network.run_all([view.crop for view in views], low=0.0)
        irises, contours = (
            np.array([view.to_frame(_points(raw)) for raw, view in zip(rows, views, strict=True)])
            for rows in (outputs[3 * IRIS_POINTS], outputs[3 * CONTOUR_POINTS])
        )
        return EyeLandmarks(irises, contours)

    def replace_eyelids(self, frame: Frame, points: Array) -> Array:
        """(468, 3) landmarks, pixels: `points` with the eyelid margins that this network finds."""
        return with_eyelid_margins(points, self.find(frame, points).contours)


def with_eyelid_margins(points: Array, contours: Sequence[Array] | Array) -> Array:
    """(468, 3) landmarks with the eyelid margins of two contours (71, 2), pixels."""
    replaced = points.copy()
    for margin, contour in zip(EYELID_MARGINS, contours, strict=True):
        replaced[list(margin), :2] = contour[list(_MARGIN_POINTS)]
    return replaced


def _eye_roi(points: Array, side: int, crop_scale: float) -> RotatedRoi:
    """The ROI of an eye.  side: 0 is the subject's right eye, 1 the left."""
    outer, inner = points[list(EYE_CORNER_PAIRS[side]), :2]
    along = (inner - outer) * (1 if side == 0 else -1)
    width = float(np.max(np.abs(along)))
    return RotatedRoi(
        (outer + inner) / 2, crop_scale * width, float(np.arctan2(along[1], along[0]))
    )


def _points(raw: NDArray[np.float32]) -> Array:
    """(n, 2) pixels of the crop, from a network's output (3 n,)."""
    return raw.astype(np.float64).reshape(-1, 3)[:, :2] - 0.5
