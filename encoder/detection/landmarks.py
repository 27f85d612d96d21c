"""468 landmarks of a face, tracked from frame to frame: MediaPipe's face mesh and iris networks."""

from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import Detection, FaceDetector
from encoder.detection.eyelids import Eyelids, eyelids_of_frame
from encoder.detection.iris import TRAINED_CROP_SCALE, IrisLandmarker
from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.detection.roi import RotatedRoi, crop_roi, roi_from_detection, roi_from_landmarks
from encoder.detection.tflite import TfliteNetwork, find_face_mesh, find_network_folder
from shared_model.arrays import Array, Picture

INPUT_PX = 192
# A search takes long in frames without a face.  After this many in vain the tracker takes a quick
# look only at one frame more after each further one, up to this many.
_SEARCHES_BEFORE_BACKOFF = 4
_MAX_BACKOFF = 8
# A search by parts takes as long as a frame lasts.  After so many in vain, each is followed by so
# many frames that are not looked at: a host where nobody is in the picture has other work.
_PARTS_BEFORE_REST, _RESTING_FRAMES = 16, 3


@dataclass(frozen=True, slots=True)
class Landmarks:
    """The landmarks of one face in one frame.

    points: (468, 3) float64: u, v pixels and depth z in pixels, growing away from the camera.
    score: probability in [0, 1] that the ROI showed a face.
    """

    points: Array
    score: float


class FaceMesh:
    """Runs the 468-point network on a given ROI of a picture.

    folder: holds the .tflite files, see `find_face_mesh`.  Raises `NetworkFilesMissing`.
    """

    def __init__(self, folder: Path) -> None:
        file = find_face_mesh(folder)
        self._network, self._pixel_centre = TfliteNetwork(file.path), file.pixel_centre_offset

    def find(self, frame: Picture, roi: RotatedRoi) -> Landmarks:
        """Landmarks of the face in the ROI of `frame` (h, w, 3) uint8 BGR."""
        pixel_from_crop = roi.pixel_from_crop(INPUT_PX)
        outputs = self._network.run(crop_roi(frame, roi, INPUT_PX), low=0.0)
        raw = outputs[LANDMARK_COUNT * 3].astype(np.float64).reshape(LANDMARK_COUNT, 3)
        flat = (raw[:, :2] - self._pixel_centre) @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2]
        depth = raw[:, 2] * roi.side / INPUT_PX
        score = 1 / (1 + np.exp(-float(outputs[1][0])))
        return Landmarks(np.column_stack([flat, depth]), score)


@dataclass(frozen=True, slots=True)
class _TrackedFace:
    """The landmarks in a frame, the ROI of the next frame, and what its eyelids begin with."""

    landmarks: Landmarks
    next_roi: RotatedRoi
    eyelids: Eyelids | None = None


@dataclass(frozen=True, slots=True)
class _Prefetched:
    """A frame whose landmarks are computed in the background before `update` asks for them."""

    frame: Picture
    job: Future[_TrackedFace | None]


class LandmarkTracker:
    """Landmarks from frame to frame: the landmarks of a frame give the ROI of the next one.

    folder: holds the .tflite files.  Raises `NetworkFilesMissing`.
    detector: finds the face in the first frame and after a loss.
    min_score: score of landmarks below which the face is lost.
    refine_eyelids: take the eyelids from the iris network, see `IrisLandmarker.replace_eyelids`.
    eye_crop_scale: see `IrisLandmarker`.
    searches_by_parts: a frame without a face takes little longer than another one; a small face may
        be found some frames later, and after a while without one any face up to three.
    alternates_eyes: see `eyelids_of_frame`.
    """

    def __init__(
        self,
        folder: Path,
        detector: FaceDetector,
        min_score: float = 0.5,
        refine_eyelids: bool = True,
        eye_crop_scale: float = TRAINED_CROP_SCALE,
        searches_by_parts: bool = False,
        alternates_eyes: bool = False,
    ) -> None:
        self._by_parts, self._alternates_eyes = searches_by_parts, alternates_eyes
        self._mesh = FaceMesh(folder)
        self._eyes = IrisLandmarker(folder, eye_crop_scale) if refine_eyelids else None
        self._detector = detector
        self._min_score = min_score
        self._roi: RotatedRoi | None = None
        self._eyelids: Eyelids | None = None
        self._misses = self._backoff = 0
        # Its thread ends with the tracker.
        self._executor = ThreadPoolExecutor(1)
        self._prefetched: _Prefetched | None = None
        self.face_count = 0

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        """Landmarks of the face in `frame` (h, w, 3) uint8 BGR; None if there is no face.

        After a detection `face_count` is the number of faces, of which the largest is tracked.
        next_frame: the array that the next call will pass as `frame`, if it is known: its landmarks
            are computed in the background.  The results are the same without it.
        """
        prefetched = self._take_prefetched(frame)
        face = prefetched.result() if prefetched else self._track(frame, self._roi, self._eyelids)
        face = face or self._with_eyelids(frame, self._redetect(frame), None)
        self._roi, self._eyelids = (face.next_roi, face.eyelids) if face else (None, None)
        if next_frame is not None and face is not None:
            job = self._executor.submit(self._track, next_frame, face.next_roi, face.eyelids)
            self._prefetched = _Prefetched(next_frame, job)
        return face.landmarks if face else None

    def set_roi(self, roi: RotatedRoi | None) -> None:
        """Set the ROI of the next frame, unless the present one is equivalent; None: detect."""
        if roi is None or self._roi is None or not self._roi.overlaps_closely(roi):
            self._take_prefetched(None)
            self._roi = roi

    def _take_prefetched(self, frame: Picture | None) -> Future[_TrackedFace | None] | None:
        """The result for `frame` if it was prefetched.

        Waits for a prefetch of another frame, since the networks serve one thread at a time.
        """
        prefetched, self._prefetched = self._prefetched, None
        if prefetched is None:
            return None
        wait([prefetched.job])
        return prefetched.job if prefetched.frame is frame else None

    def _track(
        self, frame: Picture, roi: RotatedRoi | None, before: Eyelids | None
    ) -> _TrackedFace | None:
        return self._with_eyelids(frame, self._run_mesh(frame, roi), before)

    def _with_eyelids(
        self, frame: Picture, found: Landmarks | None, before: Eyelids | None
    ) -> _TrackedFace | None:
        """The tracked face of face-mesh landmarks, with eyelids of the iris network if wanted.

        before: the eyelids in the frame before; None: not known.
        """
        if found is None:
            return None
        next_roi = roi_from_landmarks(found.points)
        if self._eyes is None:
            return _TrackedFace(found, next_roi)
        before = before if self._alternates_eyes else None
        points, eyelids = eyelids_of_frame(self._eyes, frame, found.points, before)
        return _TrackedFace(replace(found, points=points), next_roi, eyelids)

    def _redetect(self, frame: Picture) -> Landmarks | None:
        """Search the whole frame, or a part, or take a quick look where the backoff says so."""
        if self._by_parts:
            return self._search_part(frame)
        if self._backoff:
            self._backoff -= 1
            return self._first_face(frame, self._detector.detect_large(frame))
        faces = self._detector.detect(frame)
        self.face_count = len(faces)
        found = self._first_face(frame, faces)
        misses = min(self._misses + 1, _SEARCHES_BEFORE_BACKOFF + _MAX_BACKOFF)
        self._misses = 0 if found else misses
        self._backoff = max(self._misses - _SEARCHES_BEFORE_BACKOFF, 0)
        return found

    def _search_part(self, frame: Picture) -> Landmarks | None:
        if self._backoff:
            self._backoff -= 1
            return None
        faces = self._detector.detect_part(frame)
        self.face_count = len(faces)
        found = self._first_face(frame, faces)
        self._misses = 0 if found else self._misses + 1
        self._backoff = _RESTING_FRAMES if self._misses >= _PARTS_BEFORE_REST else 0
        return found

    def _first_face(self, frame: Picture, faces: list[Detection]) -> Landmarks | None:
        """Landmarks of the first face, the largest, in which the face mesh finds one."""
        for face in faces:
            first = self._run_mesh(frame, roi_from_detection(face))
            # A detection's box is rough: the first landmarks give a better ROI.
            better = first and self._run_mesh(frame, roi_from_landmarks(first.points))
            if better:
                return better
        return None

    def _run_mesh(self, frame: Picture, roi: RotatedRoi | None) -> Landmarks | None:
        if roi is None:
            return None
        found = self._mesh.find(frame, roi)
        return found if found.score >= self._min_score else None


def open_landmark_tracker(refine_eyelids: bool = True) -> LandmarkTracker:
    """A tracker with the installed networks.

    refine_eyelids: see `LandmarkTracker`.
    Raises `NetworkFilesMissing`.
    """
    folder = find_network_folder()
    return LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=refine_eyelids)
