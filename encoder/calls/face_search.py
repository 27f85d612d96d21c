"""Finds the landmarks in each frame; counts and reports the frames without a face."""

import numpy as np
from numpy.typing import NDArray

from encoder.calls.session_stats import SessionStats
from encoder.detection.landmarks import Landmarks, LandmarkTracker
from encoder.tracking.detection_measurement import warn_of_several_faces

Picture = NDArray[np.uint8]


class LandmarkSearch:
    """A landmark tracker whose time, misses and ambiguities are noted in the session's report."""

    def __init__(self, tracker: LandmarkTracker, stats: SessionStats) -> None:
        self._tracker, self._stats = tracker, stats

    def find(self, picture: Picture, next_frame: Picture | None) -> Landmarks | None:
        """The landmarks of the largest face in `picture`; None where there is none.

        next_frame: see `LandmarkTracker.update`.
        """
        with self._stats.stage("landmarks"):
            found = self._tracker.update(picture, next_frame)
        warn_of_several_faces(self._tracker.face_count, self._stats.warn)
        if found is None:
            self._stats.lost_frames += 1
        return found


def warn_of_long_search(seconds: float, limit_s: float, stats: SessionStats) -> None:
    """Add a warning if a source has shown no face in its first `seconds`, the limit or more."""
    if seconds >= limit_s:
        stats.warn(f"no face in the first {limit_s:g} s; still looking")
