"""The rotated square of a picture that a landmark network sees (region of interest, ROI)."""

from dataclasses import dataclass

import cv2
import numpy as np

from encoder.detection.detector import Detection
from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from shared_model.arrays import Array, Picture

# Side of the network's training crops, in terms of the longer side of the face's box.
_MARGIN = 1.5
# Two ROIs are equivalent for the network if the distance of their centres plus the difference of
# their sides is below this share of the smaller side, and their rolls differ by less than this.
_SAME_SHIFT, _SAME_ROLL_RAD = 0.15, 0.25
# Samples averaged along a side of a crop's pixel, at most: more take time and improve nothing.
_MAX_OVERSAMPLING = 2


@dataclass(frozen=True, slots=True)
class RotatedRoi:
    """A rotated square of a picture.

    centre: (2,) float64, pixels.  side: pixels.  roll_rad: angle of its rows, clockwise as seen.
    """

    centre: Array
    side: float
    roll_rad: float

    def overlaps_closely(self, other: "RotatedRoi") -> bool:
        """Whether a network gives much the same landmarks in both."""
        distance = np.linalg.norm(self.centre - other.centre) + abs(self.side - other.side)
        turn = abs((self.roll_rad - other.roll_rad + np.pi) % (2 * np.pi) - np.pi)
        return bool(distance < _SAME_SHIFT * min(self.side, other.side) and turn < _SAME_ROLL_RAD)

    def pixel_from_crop(self, size: int) -> Array:
        """(2, 3) affine map from pixels of the size x size crop to pixels of the picture."""
        scale = self.side / size
        cosine, sine = scale * np.cos(self.roll_rad), scale * np.sin(self.roll_rad)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        middle = np.full(2, (size - 1) / 2)
        return np.column_stack([turn, self.centre - turn @ middle])


def roi_from_detection(face: Detection) -> RotatedRoi:
    """The ROI of the face mesh for a detected face."""
    along = face.keypoints[1] - face.keypoints[0]
    side = _MARGIN * float(np.max(face.box[2:] - face.box[:2]))
    centre = (face.box[:2] + face.box[2:]) / 2
    return RotatedRoi(centre, side, float(np.arctan2(along[1], along[0])))


def roi_from_landmarks(points: Array) -> RotatedRoi:
    """The ROI of the face mesh for a face with these landmarks.

    points: (468, >= 2) pixels; nan: not known.  The outer eye corners must be known.
    """
    along = points[OUTER_EYE_CORNERS[1]] - points[OUTER_EYE_CORNERS[0]]
    low, high = np.nanmin(points[:, :2], axis=0), np.nanmax(points[:, :2], axis=0)
    side = _MARGIN * float(np.max(high - low))
    return RotatedRoi((low + high) / 2, side, float(np.arctan2(along[1], along[0])))


def crop_roi(frame: Picture, roi: RotatedRoi, size: int) -> Picture:
    """The ROI of `frame`, resampled to (size, size, 3); oversampled and averaged when it shrinks.

    Pixels beyond the frame repeat its border.
    """
    factor = min(int(np.ceil(roi.side / size)), _MAX_OVERSAMPLING)
    crop = cv2.warpAffine(
        frame,
        roi.pixel_from_crop(factor * size),
        (factor * size, factor * size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if factor > 1:
        crop = cv2.resize(crop, (size, size), interpolation=cv2.INTER_AREA)
    return np.asarray(crop, np.uint8)
