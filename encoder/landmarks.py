"""468 face landmarks a frame: MediaPipe's face mesh network under `cv2.dnn`, tracked."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detect import Detection, FaceDetector
from encoder.networks import Network, find_face_mesh

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

COUNT = 468
INPUT_PX = 192
# Outer corners of the subject's right and left eye among the landmarks: the roll of the crop.
EYE_CORNERS = (33, 263)
# The networks were trained on crops this many times the face's box.
_MARGIN = 1.5
# Samples averaged along a side of a crop's pixel, at most: beyond, time grows and nothing else.
_MOST_SAMPLES = 2
# The detector takes long where there is no face: after a few vain searches it rests one frame more
# after each, up to so many.
_SEARCHES = 4
_LONGEST_REST = 8


@dataclass(frozen=True, slots=True)
class Square:
    """A rotated square of the picture: the network's field of view.

    centre: (2,) float64, pixels.  side: pixels.  roll_rad: angle of its rows, clockwise as seen.
    """

    centre: Array
    side: float
    roll_rad: float

    def pixel_from_crop(self, size: int) -> Array:
        """(2, 3) affine map from pixels of the size x size crop to pixels of the picture."""
        scale = self.side / size
        cosine, sine = scale * np.cos(self.roll_rad), scale * np.sin(self.roll_rad)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        middle = np.full(2, (size - 1) / 2)
        return np.column_stack([turn, self.centre - turn @ middle])


@dataclass(frozen=True, slots=True)
class Landmarks:
    """The landmarks of one face in one frame.

    points: (468, 3) float64: u, v pixels and depth z in pixels, growing away from the camera.
    score: probability in [0, 1] that the crop showed a face.
    """

    points: Array
    score: float


class FaceMesh:
    """The 468-point network on one given square of a picture."""

    def __init__(self, folder: Path) -> None:
        file = find_face_mesh(folder)
        self._network, self._first_pixel = Network(file.path), file.first_pixel

    def find(self, frame: Frame, square: Square) -> Landmarks:
        """Landmarks of the face in `square` of `frame` (height, width, 3) uint8 BGR."""
        pixel_from_crop = square.pixel_from_crop(INPUT_PX)
        outputs = self._network.run(_crop(frame, square), low=0.0)
        raw = outputs[COUNT * 3].astype(np.float64).reshape(COUNT, 3)
        flat = (raw[:, :2] - self._first_pixel) @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2]
        depth = raw[:, 2] * square.side / INPUT_PX
        score = 1 / (1 + np.exp(-float(outputs[1][0])))
        return Landmarks(np.column_stack([flat, depth]), score)


class LandmarkTracker:
    """Landmarks from frame to frame: each frame's field of view comes from the frame before.

    detector: asked at the start and whenever the face is lost.
    least_score: presence below which the face counts as lost.
    """

    def __init__(self, folder: Path, detector: FaceDetector, least_score: float = 0.5) -> None:
        self._mesh = FaceMesh(folder)
        self._detector = detector
        self._least_score = least_score
        self._square: Square | None = None
        self._vain = self._rest = 0
        self.faces_seen = 0

    def update(self, frame: Frame) -> Landmarks | None:
        """Landmarks of the face in `frame` (height, width, 3) uint8 BGR; None where there is none.

        After a detection `faces_seen` tells among how many faces the largest was taken.
        """
        found = self._look(frame, self._square) or self._redetect(frame)
        self._square = square_from_landmarks(found.points) if found else None
        return found

    def steer(self, square: Square | None) -> None:
        """Look there in the next frame; None: ask the detector."""
        self._square = square

    def _redetect(self, frame: Frame) -> Landmarks | None:
        if self._rest:
            self._rest -= 1
            return None
        found = self._search(frame)
        self._vain = 0 if found else min(self._vain + 1, _SEARCHES + _LONGEST_REST)
        self._rest = max(self._vain - _SEARCHES, 0)
        return found

    def _search(self, frame: Frame) -> Landmarks | None:
        faces = self._detector.detect(frame)
        self.faces_seen = len(faces)
        for face in faces:
            first = self._look(frame, square_from_detection(face))
            # A detection's box is rough: look again where the landmarks say the face is.
            better = first and self._look(frame, square_from_landmarks(first.points))
            if better:
                return better
        return None

    def _look(self, frame: Frame, square: Square | None) -> Landmarks | None:
        if square is None:
            return None
        found = self._mesh.find(frame, square)
        return found if found.score >= self._least_score else None


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


def _crop(frame: Frame, square: Square) -> Frame:
    """`square` of `frame`, INPUT_PX wide; what the crop would alias is averaged instead."""
    finer = min(int(np.ceil(square.side / INPUT_PX)), _MOST_SAMPLES)
    size = finer * INPUT_PX
    crop = cv2.warpAffine(
        frame,
        square.pixel_from_crop(size),
        (size, size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if finer > 1:
        crop = cv2.resize(crop, (INPUT_PX, INPUT_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(crop, np.uint8)
