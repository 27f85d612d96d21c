"""Where in a picture the landmark networks look: rotated squares about a face."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.blazeface import Detection
from encoder.detection.landmark_indices import EYE_CORNERS

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

# The networks were trained on crops this many times the face's box.
_MARGIN = 1.5
# Squares show the face alike whose centres and sides together differ by less than this share of the
# smaller side, and which are turned by less against each other.
_NEAR, _NEAR_RAD = 0.15, 0.25
# Samples averaged along a side of a crop's pixel, at most: beyond, time grows and nothing else.
_MOST_SAMPLES = 2


@dataclass(frozen=True, slots=True)
class Square:
    """A rotated square of the picture: the network's field of view.

    centre: (2,) float64, pixels.  side: pixels.  roll_rad: angle of its rows, clockwise as seen.
    """

    centre: Array
    side: float
    roll_rad: float

    def is_near(self, other: "Square") -> bool:
        """Whether the network sees much the same face in both."""
        apart = np.linalg.norm(self.centre - other.centre) + abs(self.side - other.side)
        turn = abs((self.roll_rad - other.roll_rad + np.pi) % (2 * np.pi) - np.pi)
        return bool(apart < _NEAR * min(self.side, other.side) and turn < _NEAR_RAD)

    def pixel_from_crop(self, size: int) -> Array:
        """(2, 3) affine map from pixels of the size x size crop to pixels of the picture."""
        scale = self.side / size
        cosine, sine = scale * np.cos(self.roll_rad), scale * np.sin(self.roll_rad)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        middle = np.full(2, (size - 1) / 2)
        return np.column_stack([turn, self.centre - turn @ middle])


def square_from_detection(face: Detection) -> Square:
    """Where the network should look for the landmarks of a detected face."""
    along = face.keypoints[1] - face.keypoints[0]
    side = _MARGIN * float(np.max(face.box[2:] - face.box[:2]))
    centre = (face.box[:2] + face.box[2:]) / 2
    return Square(centre, side, float(np.arctan2(along[1], along[0])))


def square_from_landmarks(points: Array) -> Square:
    """Where the network should look for the face whose landmarks (468, >= 2) are `points`.

    Points that are nan are not known; the corners of the eyes must be.
    """
    along = points[EYE_CORNERS[1]] - points[EYE_CORNERS[0]]
    low, high = np.nanmin(points[:, :2], axis=0), np.nanmax(points[:, :2], axis=0)
    side = _MARGIN * float(np.max(high - low))
    return Square((low + high) / 2, side, float(np.arctan2(along[1], along[0])))


def cut_out(frame: Frame, square: Square, size: int) -> Frame:
    """`square` of `frame`, (size, size, 3); what would alias is averaged instead."""
    finer = min(int(np.ceil(square.side / size)), _MOST_SAMPLES)
    crop = cv2.warpAffine(
        frame,
        square.pixel_from_crop(finer * size),
        (finer * size, finer * size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if finer > 1:
        crop = cv2.resize(crop, (size, size), interpolation=cv2.INTER_AREA)
    return np.asarray(crop, np.uint8)
