"""The landmark network as a source of landmarks for the tracker."""

from encoder.detection.landmarks import Landmarks, LandmarkTracker
from encoder.detection.roi import roi_from_landmarks
from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Picture


class NetworkLandmarks:
    """A `LandmarkSource` by the network, which looks where the face is expected."""

    sigma_ratio, every_frame = 1.0, True

    def __init__(self, tracker: LandmarkTracker) -> None:
        self._tracker = tracker

    @property
    def face_count(self) -> int:
        """See `LandmarkSource`."""
        return self._tracker.face_count

    def expect(self, face: ExpectedFace | None) -> None:
        """See `LandmarkSource`."""
        self._tracker.set_roi(None if face is None else roi_from_landmarks(face.points_px))

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        """See `LandmarkSource`."""
        return self._tracker.update(frame, next_frame)
