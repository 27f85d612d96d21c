"""468 face landmarks a frame: MediaPipe's face mesh and iris networks, tracked."""

from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from encoder.detection.blazeface import FaceDetector
from encoder.detection.iris import TRAINED_CROP, IrisFinder
from encoder.detection.landmark_indices import COUNT
from encoder.detection.roi import Square, cut_out, square_from_detection, square_from_landmarks
from encoder.detection.tflite import Network, find_face_mesh

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 192
# The detector takes long where there is no face: after a few vain searches it rests one frame more
# after each, up to so many.
_SEARCHES = 4
_LONGEST_REST = 8


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
        outputs = self._network.run(cut_out(frame, square, INPUT_PX), low=0.0)
        raw = outputs[COUNT * 3].astype(np.float64).reshape(COUNT, 3)
        flat = (raw[:, :2] - self._first_pixel) @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2]
        depth = raw[:, 2] * square.side / INPUT_PX
        score = 1 / (1 + np.exp(-float(outputs[1][0])))
        return Landmarks(np.column_stack([flat, depth]), score)


@dataclass(frozen=True, slots=True)
class _Seen:
    """The landmarks in a frame, and where to look in the next one."""

    landmarks: Landmarks
    next_square: Square


@dataclass(frozen=True, slots=True)
class _Ahead:
    """A look at a frame before its turn."""

    frame: Frame
    job: Future[_Seen | None]


class LandmarkTracker:
    """Landmarks from frame to frame: each frame's field of view comes from the frame before.

    detector: asked at the start and whenever the face is lost.
    least_score: presence below which the face counts as lost.
    look_at_lids: see them by the iris network, see `IrisFinder.with_lids`; else by the face mesh.
    eye_crop: how wide that network looks, in widths of an eye.
    """

    def __init__(
        self,
        folder: Path,
        detector: FaceDetector,
        least_score: float = 0.5,
        look_at_lids: bool = True,
        eye_crop: float = TRAINED_CROP,
    ) -> None:
        self._mesh = FaceMesh(folder)
        self._eyes = IrisFinder(folder, eye_crop) if look_at_lids else None
        self._detector = detector
        self._least_score = least_score
        self._square: Square | None = None
        self._vain = self._rest = 0
        # Ends with the tracker.
        self._beside = ThreadPoolExecutor(1)
        self._ahead: _Ahead | None = None
        self.faces_seen = 0

    def update(self, frame: Frame, coming: Frame | None = None) -> Landmarks | None:
        """Landmarks of the face in `frame` (height, width, 3) uint8 BGR; None where there is none.

        After a detection `faces_seen` tells among how many faces the largest was taken.
        coming: the array that will be the next frame, where it is there already: it is looked at
            beside what the caller does until then.  The landmarks are the same without.
        """
        ahead = self._take_ahead(frame)
        seen = ahead.result() if ahead else self._see(frame, self._square)
        seen = seen or self._seen(frame, self._redetect(frame))
        self._square = seen.next_square if seen else None
        if coming is not None and seen is not None:
            job = self._beside.submit(self._see, coming, seen.next_square)
            self._ahead = _Ahead(coming, job)
        return seen.landmarks if seen else None

    def steer(self, square: Square | None) -> None:
        """Look there in the next frame, unless the landmarks lead close to there; None: search."""
        if square is None or self._square is None or not self._square.is_near(square):
            self._take_ahead(None)
            self._square = square

    def _take_ahead(self, frame: Frame | None) -> Future[_Seen | None] | None:
        """The look at `frame` while it was still to come, if there was one.

        The networks are free once it is done: one at another frame is waited for.
        """
        ahead, self._ahead = self._ahead, None
        if ahead is None:
            return None
        wait([ahead.job])
        return ahead.job if ahead.frame is frame else None

    def _see(self, frame: Frame, square: Square | None) -> _Seen | None:
        return self._seen(frame, self._look(frame, square))

    def _seen(self, frame: Frame, found: Landmarks | None) -> _Seen | None:
        """What the face mesh has found, with the lids as they are to be seen."""
        if found is None:
            return None
        square = square_from_landmarks(found.points)
        if self._eyes is not None:
            found = replace(found, points=self._eyes.with_lids(frame, found.points))
        return _Seen(found, square)

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
