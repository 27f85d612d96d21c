"""Finds the caller's face in each frame of a live call, and notices when it is somebody else's."""

from encoder.calls.face_search import open_landmark_search
from encoder.calls.session_stats import SessionStats
from encoder.detection.iris import WIDE_CROP_SCALE
from encoder.person.person_watch import PersonWatch, Verdict
from shared_model.arrays import Array, Picture

# Frames that are left out until it is known whose face they have; a face that is turned away for
# longer is taken for the same.
MAX_HELD_FRAMES = 4


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
