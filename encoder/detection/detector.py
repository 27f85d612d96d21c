"""What all face detectors have in common."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from shared_model.arrays import Array, Picture

# Order of `Detection.keypoints`; left and right are the subject's.
KEYPOINTS = ("eye_right", "eye_left", "nose", "mouth", "ear_right", "ear_left")
Warn = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Detection:
    """A face found in a picture.

    box: (4,) float64, pixels: left, top, right, bottom of brow-to-chin; may leave the picture.
    keypoints: (6, 2) float64, pixels, in the order of `KEYPOINTS`.
    score: confidence in [0, 1].
    """

    box: Array
    keypoints: Array
    score: float

    @property
    def size_px(self) -> float:
        """Geometric mean of the box's sides, pixels."""
        width, height = self.box[2:] - self.box[:2]
        return float(np.sqrt(width * height))


class FaceDetector(Protocol):
    """A detector of faces in (h, w, 3) uint8 BGR pictures; it returns the largest face first."""

    def detect(self, frame: Picture) -> list[Detection]: ...

    def detect_large(self, frame: Picture) -> list[Detection]:
        """Faces that a quick look at the whole picture shows."""

    def detect_part(self, frame: Picture) -> list[Detection]:
        """Faces in the whole picture, or in a part of it: parts take turns from frame to frame."""


def by_size(detections: list[Detection]) -> list[Detection]:
    """The detections, the largest first."""
    return sorted(detections, key=lambda face: -face.size_px)


def warn_of_several_faces(count: int, warn: Warn) -> None:
    """Warn if several faces are in the picture."""
    if count > 1:
        warn(f"{count} faces in the picture: taking the largest")
