"""Finds the landmarks of one face in each frame; reports what is missing or ambiguous.

In a live call also whether the face is still that of the same person.
"""

from encoder.calls.session_stats import SessionStats
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import warn_of_several_faces
from encoder.detection.iris import TRAINED_CROP_SCALE, WIDE_CROP_SCALE
from encoder.detection.landmarks import FaceMesh, Landmarks, LandmarkTracker
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.person.followed_face import FollowedFace
from encoder.person.person_watch import PersonWatch, Verdict
from encoder.person.scene_cuts import CutDetector
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError

SWITCHED = "another face is followed: the one before never moved, or is much smaller"
# Frames that are left out until it is known whose face they have; a face that is turned away for
# longer is taken for the same.
MAX_HELD_FRAMES = 4


class LandmarkSearch:
    """A landmark tracker whose time, misses and ambiguities are noted in the session's report.

    followed: which of several faces is meant.
    is_cut: there is a cut before the newest frame.  has_switched: from the newest frame on it is
        another face.
    """

    def __init__(
        self, tracker: LandmarkTracker, stats: SessionStats, followed: FollowedFace
    ) -> None:
        self._tracker, self._stats, self._followed = tracker, stats, followed
        self._cuts = CutDetector()
        self.is_cut = self.has_switched = False

    def find(self, picture: Picture, next_frame: Picture | None) -> Landmarks | None:
        """The landmarks of the face that is followed in `picture`; None where there is none.

        next_frame: see `LandmarkTracker.update`.
        """
        with self._stats.stage("landmarks"):
            self.is_cut, self.has_switched = self._cuts.is_cut(picture), False
            if self.is_cut:
                self._tracker.set_roi(None)
            found = self._tracker.update(picture, next_frame)
            better = None if found is None else self._followed.look(picture, found.points)
            if better is not None:
                self._tracker.set_roi(better)
                found, self.has_switched = self._tracker.update(picture, next_frame), True
                self._stats.warn(SWITCHED)
        warn_of_several_faces(self._tracker.face_count, self._stats.warn)
        if found is None:
            self._stats.lost_frames += 1
        return found


def open_landmark_search(
    stats: SessionStats,
    refine_eyelids: bool = True,
    eye_crop_scale: float = TRAINED_CROP_SCALE,
    in_real_time: bool = False,
) -> LandmarkSearch:
    """A search with the installed networks.

    refine_eyelids, eye_crop_scale: see `LandmarkTracker`.
    in_real_time: in less time, see `searches_by_parts` and `alternates_eyes` there.
    Raises `UserError` if the networks are missing.
    """
    try:
        folder = find_network_folder()
        detector = BlazeFaceDetector(folder)
        tracker = LandmarkTracker(
            folder,
            detector,
            refine_eyelids=refine_eyelids,
            eye_crop_scale=eye_crop_scale,
            searches_by_parts=in_real_time,
            alternates_eyes=in_real_time,
        )
    except NetworkFilesMissing as error:
        raise UserError(f"{error}; without them use --profile thesis") from error
    return LandmarkSearch(tracker, stats, FollowedFace(detector, FaceMesh(folder)))


def warn_of_long_search(seconds: float, limit_s: float, stats: SessionStats) -> None:
    """Add a warning if a source has shown no face in its first `seconds`, the limit or more."""
    if seconds >= limit_s:
        stats.warn(f"no face in the first {limit_s:g} s; still looking")


class CallerSearch:
    """Looks at one frame after the other."""

    def __init__(self, stats: SessionStats) -> None:
        self._search = open_landmark_search(
            stats, eye_crop_scale=WIDE_CROP_SCALE, in_real_time=True
        )
        self._watch, self._undecided = PersonWatch(), 0

    def find(self, picture: Picture, next_frame: Picture | None) -> tuple[Array | None, bool]:
        """The landmarks (468, 3), pixels, of the face in a frame, None where there is none or it is
        not known whose it is; and whether from this frame on it is somebody else's.

        picture: (h, w, 3) BGR; empty: the camera is off.  next_frame: see `LandmarkTracker.update`.
        """
        if not picture.size:
            return None, False
        found = self._search.find(picture, next_frame)
        if found is None:
            self._watch.miss()
            return None, False
        verdict = self._watch.judge(picture, found.points, self._search.is_cut)
        if self._search.has_switched:
            self._watch.begin()
            verdict = Verdict.OTHER
        self._undecided = self._undecided + 1 if verdict is Verdict.UNDECIDED else 0
        is_held = 0 < self._undecided <= MAX_HELD_FRAMES
        return None if is_held else found.points, verdict is Verdict.OTHER
