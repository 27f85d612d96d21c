"""What finds the landmarks of a face, picture by picture: a network, or a statistical model."""

from dataclasses import dataclass
from typing import Protocol

from encoder.detection.landmarks import Landmarks
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.parameters import FaceParameters


@dataclass(frozen=True, slots=True)
class ExpectedFace:
    """Where a face is expected in the next picture.

    points_px: (468, 3) its landmarks, nan where the head has none, and for depth.
    camera, face: pose and actuators before a camera.  aau: (11,) of the person.
    """

    points_px: Array
    camera: Camera
    face: FaceParameters
    aau: Array


class LandmarkSource(Protocol):
    """Finds the landmarks of one face in picture after picture.

    face_count: of the newest search of a whole picture.
    sigma_ratio: standard deviation of its landmarks, in terms of the landmark network's.
    every_frame: whether its landmarks measure every frame, or the first face, and lost ones, alone.
    """

    @property
    def face_count(self) -> int: ...
    @property
    def sigma_ratio(self) -> float: ...
    @property
    def every_frame(self) -> bool: ...

    def expect(self, face: ExpectedFace | None) -> None:
        """Where the face is expected in the next picture; None: anywhere."""

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        """The landmarks in a picture (h, w, 3) BGR; None where there is no face.

        next_frame: the picture that follows, if it is known: saves time only.
        """
