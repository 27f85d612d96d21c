"""How near a decoded video is to its source: PSNR over the face and over the whole picture."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.video_source import Capture, open_source
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from loopback.report import rounded
from shared_model.errors import UserError

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Progress = Callable[[int, int | None], None]
# The face area of a picture, (height, width) bool; None: no face.
FaceArea = Callable[[Picture], Mask | None]

# The points of the 468-point face mesh on the outline of the face.
FACE_OVAL = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288),
    *(397, 365, 379, 378, 400, 377, 152, 148, 176, 149, 150, 136),
    *(172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
# Two pictures without any difference: the error is taken as this, so that a mean stays finite.
LEAST_SQUARED_ERROR = 1e-6


@dataclass(frozen=True, slots=True)
class Quality:
    """PSNR of luma (eq. 6.1), dB: mean over the frames and 5th percentile.

    frames: compared; face_frames: those of them whose source shows a face.
    face_*: over the face area of the source, None without any face; full_*: over the whole picture.
    """

    frames: int
    face_frames: int
    face_psnr_db: float | None
    face_psnr_p5_db: float | None
    full_psnr_db: float | None
    full_psnr_p5_db: float | None


class TrackedFaceArea:
    """The face area of one picture after another, from the landmark network.

    Raises `NetworkFilesMissing` where it is not installed.
    """

    def __init__(self) -> None:
        folder = find_network_folder()
        self._tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), look_at_lids=False)

    def __call__(self, picture: Picture) -> Mask | None:
        """The area inside the outline of the face in `picture`; None if there is no face."""
        found = self._tracker.update(picture)
        return None if found is None else oval_area(found.points, *picture.shape[:2])


def measure(
    source: str,
    decoded: str,
    face_area: FaceArea,
    progress: Progress,
    max_frames: int | None = None,
) -> Quality:
    """Compare a decoded video with its source, frame by frame.

    source, decoded: anything `open_source` opens.  max_frames: the part of the source that was
    encoded.
    Raises `UserError` if they have different sizes or numbers of frames.
    """
    face: list[float] = []
    full: list[float] = []
    with open_source(source) as originals, open_source(decoded) as copies:
        check_size(originals, copies.name, copies.width, copies.height)
        for index, (original, copy) in enumerate(zip_longest(originals, copies)):
            if index == max_frames and copy is None:
                break
            if original is None or copy is None:
                raise UserError(
                    f"{decoded} and {source} have different numbers of frames: one ends at {index}"
                )
            error = squared_error(original[1], copy[1])
            full.append(psnr_db(error))
            area = face_area(original[1])
            if area is not None and area.any():
                face.append(psnr_db(error[area]))
            progress(index + 1, originals.frame_count)
    return Quality(len(full), len(face), *_mean_and_p5(face), *_mean_and_p5(full))


def squared_error(original: Picture, copy: Picture) -> NDArray[np.float64]:
    """Squared difference of luma, (height, width)."""
    first, second = (
        cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float64) for picture in (original, copy)
    )
    return np.asarray((first - second) ** 2)


def psnr_db(error: NDArray[np.float64]) -> float:
    """Peak signal-to-noise ratio of squared errors, dB (eq. 6.1)."""
    return float(10 * np.log10(255.0**2 / max(float(error.mean()), LEAST_SQUARED_ERROR)))


def oval_area(points_px: NDArray[np.floating], height: int, width: int) -> Mask:
    """The area inside the face's outline.  points_px: (468 or more, 2 or more), pixels."""
    outline = np.round(points_px[list(FACE_OVAL), :2]).astype(np.int32)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(outline), 1)
    return mask.astype(np.bool_)


def check_size(originals: Capture, copy: str, width: int, height: int) -> None:
    """Raise `UserError` if what is called `copy` has not the size of its source."""
    if (originals.width, originals.height) != (width, height):
        raise UserError(
            f"{copy} is {width}x{height} but {originals.name} is"
            f" {originals.width}x{originals.height}: is it another call's?"
        )


def _mean_and_p5(values: list[float]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    return rounded(float(np.mean(values))), rounded(float(np.percentile(values, 5)))


def face_area_finder(warn: Callable[[str], None]) -> FaceArea:
    """The best finder that is installed; without the landmark network no face is measured."""
    try:
        return TrackedFaceArea()
    except NetworkFilesMissing as error:
        warn(f"risorius: warning: {error}; no PSNR over the face")
        return lambda picture: None
