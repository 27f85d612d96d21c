"""Viola-Jones face detection (thesis 5.1): Haar cascades for face and eyes, and for the nose.

OpenCV comes without a cascade for noses; without one the nose, as the other keypoints, is placed by
the proportions of a face.
"""

from pathlib import Path

import cv2
import numpy as np

from encoder.capture.colour import luma_u8
from encoder.detection.detector import KEYPOINTS, Detection, by_size
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError

# (longer side of the searched picture, pixels; roll of the face, degrees), the quickest and most
# frequent first.
_SEARCH_PASSES = ((480, 0), (480, 20), (480, -20), (480, 40), (480, -40), (1280, 0))
_EYE_WORKING_PX = 160
# Half the side of the square about the expected place in which the nose is searched, and the least
# width of a nose, in terms of the eyes' distance.
_NOSE_REACH, _LEAST_NOSE = 0.75, 0.35
_NOSE = KEYPOINTS.index("nose")

# Default height of the eyes in a face box, and their distance from its vertical axis; fractions of
# the box.
_EYE_LEVEL, _EYE_OFFSET = 0.39, 0.19
# Nose tip, mouth and ears relative to the point between the eyes, in units of the eyes' distance:
# (along the line through the eyes, across it towards the chin), order of `KEYPOINTS`[2:].
_KEYPOINTS_FROM_EYES = np.array([[0.0, 0.59], [0.0, 1.08], [-1.07, 0.28], [1.07, 0.28]])


class HaarDetector:
    """Finds upright and moderately rolled frontal faces without a neural network.

    nose: a file with a cascade for noses; None: they are placed.  Raises `UserError` if it is none.
    """

    def __init__(self, nose: Path | None = None) -> None:
        self._nose = None if nose is None else _nose_cascade(nose)
        self._face = _cascade("haarcascade_frontalface_alt2.xml")
        self._eyes = [
            _cascade("haarcascade_eye_tree_eyeglasses.xml"),
            _cascade("haarcascade_eye.xml"),
        ]

    def detect_large(self, frame: Picture) -> list[Detection]:
        """See `FaceDetector`: there is no quicker look."""
        return self.detect(frame)

    def detect_part(self, frame: Picture) -> list[Detection]:
        """See `FaceDetector`: there are no parts."""
        return self.detect(frame)

    def detect(self, frame: Picture) -> list[Detection]:
        """Faces in `frame` (h, w, 3) uint8 BGR, the largest first.

        Rolled faces are searched only if there is no upright one.
        """
        for long_px, roll_deg in _SEARCH_PASSES:
            small = _grey(frame, long_px)
            found = self._detect_rolled(small, roll_deg)
            if found:
                height, width = frame.shape[:2]
                factor = np.array([width / small.shape[1], height / small.shape[0]])
                return by_size([_scaled(face, factor) for face in found])
        return []

    def _detect_rolled(self, grey: Picture, roll_deg: float) -> list[Detection]:
        """Faces rolled by `roll_deg` in a luma picture, in pixels of that picture."""
        middle = ((grey.shape[1] - 1) / 2, (grey.shape[0] - 1) / 2)
        upright_from_grey = cv2.getRotationMatrix2D(middle, roll_deg, 1.0)
        upright = cv2.warpAffine(grey, upright_from_grey, grey.shape[::-1])
        back = np.asarray(cv2.invertAffineTransform(upright_from_grey), np.float64)
        boxes, counts = self._face.detectMultiScale2(upright, 1.1, 4, minSize=(36, 36))
        found = []
        for (left, top, width, height), count in zip(boxes, counts, strict=True):
            face = np.asarray(upright[top : top + height, left : left + width], np.uint8)
            keypoints = _keypoints(self._find_eyes(face) + np.array([left, top]))
            keypoints[_NOSE] = self._find_nose(np.asarray(upright, np.uint8), keypoints)
            centre = np.array([left, top]) + (np.array([width, height]) - 1) / 2
            half = np.array([width, height]) / 2
            turned = back[:, :2] @ centre + back[:, 2]
            box = np.concatenate([turned - half, turned + half])
            score = float(count) / (float(count) + 4)
            found.append(Detection(box, keypoints @ back[:, :2].T + back[:, 2], score))
        return found

    def _find_eyes(self, face: Picture) -> Array:
        """(2, 2) pixels in `face`: the subject's right eye (left in the picture), then the left."""
        side = face.shape[0]
        zoom = _EYE_WORKING_PX / side
        large = cv2.resize(face, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
        defaults = np.array([[0.5 - _EYE_OFFSET, _EYE_LEVEL], [0.5 + _EYE_OFFSET, _EYE_LEVEL]])
        eyes = [self._find_eye(np.asarray(large, np.uint8), default) for default in defaults]
        return np.asarray((np.array(eyes) + 0.5) / zoom - 0.5)

    def _find_eye(self, face: Picture, default: Array) -> Array:
        """The eye's centre, pixels: searched around `default`, which is returned if there is none.

        default: (2,) fractions of the face's box.
        """
        side = face.shape[0]
        expected: Array = default * side
        start = np.round(expected - 0.2 * side).astype(int)
        stop = np.round(expected + 0.2 * side).astype(int)
        area = face[max(start[1], 0) : stop[1], max(start[0], 0) : stop[0]]
        least = (round(0.12 * side), round(0.12 * side))
        for cascade in self._eyes:
            boxes, counts = cascade.detectMultiScale2(area, 1.05, 3, minSize=least)
            if len(boxes):
                left, top, width, height = boxes[int(np.argmax(counts))]
                return np.array(
                    [start[0] + left + (width - 1) / 2, start[1] + top + (height - 1) / 2]
                )
        return expected

    def _find_nose(self, grey: Picture, keypoints: Array) -> Array:
        """(2,) pixels: the middle of the nose that is nearest to where it is expected."""
        expected: Array = keypoints[_NOSE]
        if self._nose is None:
            return expected
        eyes_px = float(np.linalg.norm(keypoints[1] - keypoints[0]))
        start = np.maximum(np.round(expected - _NOSE_REACH * eyes_px).astype(int), 0)
        stop = np.round(expected + _NOSE_REACH * eyes_px).astype(int)
        zoom = _EYE_WORKING_PX / (2 * _NOSE_REACH * eyes_px)
        area = grey[start[1] : stop[1], start[0] : stop[0]]
        if not area.size:
            return expected
        large = cv2.resize(area, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
        least = round(_LEAST_NOSE * eyes_px * zoom)
        boxes = self._nose.detectMultiScale(large, 1.05, 3, minSize=(least, least))
        middles = [start + (np.array([x + w / 2, y + h / 2]) / zoom - 0.5) for x, y, w, h in boxes]
        return min(middles, key=lambda at: float(np.linalg.norm(at - expected)), default=expected)


def _grey(frame: Picture, long_px: int) -> Picture:
    """Luma of `frame` after histogram equalisation, its longer side `long_px`."""
    scale = long_px / max(frame.shape[:2])
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=method)
    return np.asarray(cv2.equalizeHist(luma_u8(np.asarray(small, np.uint8))), np.uint8)


def _keypoints(eyes: Array) -> Array:
    """(6, 2) pixels, order of `KEYPOINTS`, from the centres of the eyes (2, 2)."""
    along = eyes[1] - eyes[0]
    across = np.array([-along[1], along[0]])
    return np.concatenate([eyes, eyes.mean(0) + _KEYPOINTS_FROM_EYES @ np.stack([along, across])])


def _scaled(face: Detection, factor: Array) -> Detection:
    """The detection in pixels of a picture that is `factor` (2,) times as large."""
    box = (face.box.reshape(2, 2) + 0.5) * factor - 0.5
    return Detection(box.ravel(), (face.keypoints + 0.5) * factor - 0.5, face.score)


def _nose_cascade(path: Path) -> cv2.CascadeClassifier:
    try:
        cascade = cv2.CascadeClassifier(str(path)) if path.is_file() else None
    except (cv2.error, SystemError):
        # OpenCV's binding raises the one within the other.
        cascade = None
    if cascade is None or cascade.empty():
        raise UserError(f"{path} is no cascade classifier of OpenCV")
    return cascade


def _cascade(name: str) -> cv2.CascadeClassifier:
    path = Path(cv2.__file__).parent / "data" / name
    cascade = cv2.CascadeClassifier(str(path))
    if cascade.empty():
        raise RuntimeError(f"OpenCV's installation lacks {path}")
    return cascade
