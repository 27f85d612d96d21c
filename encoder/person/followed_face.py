"""Which of several faces is followed: a picture on the wall gives way to who lives.

Now and then all large faces of the picture are looked for.  A face that has never moved, or one
that is much smaller, gives way to one that moves; of two that live the followed one stays.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import FaceMesh
from encoder.detection.roi import RotatedRoi, roi_from_detection, roi_from_landmarks
from shared_model.arrays import Array, Picture

# Source frames from one look to the next, and looks by which motion is told.
LOOK_INTERVAL, LOOKS = 12, 4
# A face moves if its place changes by more than this, in terms of its size, and its shape by more
# than that, in terms of the root mean square distance of its landmarks from their mean.  Of
# thirteen clips, at most .0033 and .02 where one frame is held, at least .007 and .022 otherwise.
MOVED_PLACE, MOVED_SHAPE = 0.005, 0.021
# A face that is so many times as large as the followed one is the one that is meant.
MUCH_LARGER = 2.0
MIN_SCORE = 0.5


@dataclass(slots=True)
class WatchedFace:
    """The landmarks (468, 2) of one face at the newest looks."""

    looks: deque[Array] = field(default_factory=lambda: deque(maxlen=LOOKS))

    def add(self, points: Array) -> None:
        """Landmarks (468, >= 2), pixels."""
        self.looks.append(points[:, :2])

    @property
    def size_px(self) -> float:
        """Root mean square distance of the landmarks from their mean."""
        return float(_normal(self.looks[-1])[1])

    @property
    def centre(self) -> Array:
        """(2,) pixels."""
        return np.asarray(self.looks[-1].mean(0))

    @property
    def has_moved(self) -> bool | None:
        """Whether the face moves or its features do; None: not known yet."""
        if len(self.looks) < 2:
            return None
        shapes = np.array([_normal(points)[0] for points in self.looks])
        places = np.array([points.mean(0) for points in self.looks])
        width = float(np.ptp(self.looks[0][:, 0]))
        shape = float(np.percentile(shapes.std(0).sum(1), 95))
        place = float(np.abs(places - places.mean(0)).max()) / max(width, 1e-9)
        has_moved = shape > MOVED_SHAPE or place > MOVED_PLACE
        return has_moved if has_moved or len(self.looks) == LOOKS else None

    def is_at(self, centre: Array, size_px: float) -> bool:
        """Whether this face was about at `centre` (2,), pixels, at the newest look."""
        near = 2 * max(self.size_px, size_px)
        return bool(np.linalg.norm(self.centre - centre) < near)


class FollowedFace:
    """Looks for a face that the followed one has to give way to.

    detector, mesh: see there.
    """

    def __init__(self, detector: BlazeFaceDetector, mesh: FaceMesh) -> None:
        self._detector, self._mesh = detector, mesh
        self._followed, self._has_lived = WatchedFace(), False
        self._others: list[WatchedFace] = []
        self._until_look = 0

    def forget(self) -> None:
        """Another face is followed from now on."""
        self._followed, self._has_lived, self._others = WatchedFace(), False, []

    def look(self, picture: Picture, points: Array) -> RotatedRoi | None:
        """Where the face is that is to be followed instead; None: go on.

        picture: (h, w, 3) uint8 BGR.  points: (468, 3) landmarks of the followed face in it.
        """
        if self._until_look:
            self._until_look -= 1
            return None
        self._until_look = LOOK_INTERVAL - 1
        if self._followed.looks and not self._followed.is_at(points[:, :2].mean(0), 0.0):
            self.forget()
        self._followed.add(points)
        self._has_lived |= bool(self._followed.has_moved)
        self._watch_others(picture)
        for other in sorted(self._others, key=lambda face: -face.size_px):
            is_dead = self._followed.has_moved is False and not self._has_lived
            is_larger = other.size_px > MUCH_LARGER * self._followed.size_px
            if other.has_moved and (is_dead or is_larger):
                self.forget()
                return roi_from_landmarks(other.looks[-1])
        return None

    def _watch_others(self, picture: Picture) -> None:
        before, self._others = self._others, []
        for face in self._detector.detect_large(picture):
            # The box is enough to see that this is the followed one, without its landmarks.
            if self._followed.is_at((face.box[:2] + face.box[2:]) / 2, 0.0):
                continue
            found = self._mesh.find(picture, roi_from_detection(face))
            if found.score < MIN_SCORE:
                continue
            # A detection's box is rough: the first landmarks give a better ROI.
            found = self._mesh.find(picture, roi_from_landmarks(found.points))
            place, size_px = found.points[:, :2].mean(0), _normal(found.points[:, :2])[1]
            if found.score < MIN_SCORE or self._followed.is_at(place, size_px):
                continue
            known = [other for other in before if other.is_at(place, size_px)]
            other = known[0] if known else WatchedFace()
            other.add(found.points)
            self._others.append(other)


def _normal(points: Array) -> tuple[Array, float]:
    """Landmarks (468, 2) with mean 0 and size 1, and their size."""
    middle = points - points.mean(0)
    size = float(np.sqrt((middle**2).sum(1).mean()))
    return middle / max(size, 1e-9), size
