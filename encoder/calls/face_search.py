"""Finds the landmarks in each frame; counts and reports the frames without a face."""

import numpy as np
from numpy.typing import NDArray

from encoder.calls.session_stats import SessionStats
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.iris import TRAINED_CROP_SCALE
from encoder.detection.landmarks import Landmarks, LandmarkTracker
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.tracking.detection_measurement import warn_of_several_faces
from shared_model.errors import UserError

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


def open_landmark_search(
    stats: SessionStats, refine_eyelids: bool = True, eye_crop_scale: float = TRAINED_CROP_SCALE
) -> LandmarkSearch:
    """A search with the installed networks.

    refine_eyelids, eye_crop_scale: see `LandmarkTracker`.
    Raises `UserError` if the networks are missing.
    """
    try:
        folder = find_network_folder()
        detector = BlazeFaceDetector(folder)
        tracker = LandmarkTracker(
            folder, detector, refine_eyelids=refine_eyelids, eye_crop_scale=eye_crop_scale
        )
    except NetworkFilesMissing as error:
        raise UserError(f"{error}; without them use --profile thesis") from error
    return LandmarkSearch(tracker, stats)


def warn_of_long_search(seconds: float, limit_s: float, stats: SessionStats) -> None:
    """Add a warning if a source has shown no face in its first `seconds`, the limit or more."""
    if seconds >= limit_s:
        stats.warn(f"no face in the first {limit_s:g} s; still looking")
