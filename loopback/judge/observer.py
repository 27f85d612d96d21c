"""Who looks at the two videos: where the face's landmarks and the person are.

A figure is independent only if its observer is: one that the encoder fits by finds what the encoder
has put there.
"""

import os
from collections.abc import Iterable, Sequence
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.detection.landmarks import LandmarkTracker, open_landmark_tracker
from encoder.detection.segmentation import person_probability
from encoder.detection.tflite import NetworkFilesMissing, find_segmentation_network
from loopback.judge.programs import run_program
from shared_model.arrays import Array, Mask, Picture
from shared_model.errors import UserError

# The Python of the judge's environment; `make judge` makes the second one.
ENVIRONMENT_VARIABLE, ENVIRONMENT = "RISORIUS_JUDGE", ".judge/bin/python"
PERSON = 0.5


class Observer(Protocol):
    """Looks at pictures (h, w, 3) uint8 BGR of one size, in square pixels.

    name: for reports.  is_independent: the encoder does not use what it looks with.
    """

    @property
    def name(self) -> str: ...

    @property
    def is_independent(self) -> bool: ...

    def landmarks(self, pictures: Iterable[Picture]) -> Array:
        """(n, 468, 3) pixels, nan where no face is found."""

    def people(self, pictures: Iterable[Picture]) -> Sequence[Mask] | None:
        """Where a person is; None: it cannot tell."""


class EncoderNetworks:
    """The encoder's own networks stand in where there is no judge."""

    name, is_independent = "the encoder's own networks", False

    def __init__(self) -> None:
        self._segmentation = find_segmentation_network()

    def landmarks(self, pictures: Iterable[Picture]) -> Array:
        """See `Observer`; without the networks no face is found."""
        tracker = _tracker()
        points = [_landmarks(tracker, picture) for picture in pictures]
        return np.array(points).reshape(-1, LANDMARK_COUNT, 3)

    def people(self, pictures: Iterable[Picture]) -> Sequence[Mask] | None:
        """See `Observer`."""
        path = self._segmentation
        return None if path is None else [person_mask(path, picture) for picture in pictures]


def person_mask(path: Path, picture: Picture) -> Mask:
    """(h, w) where the segmentation network at `path` sees a person in a picture (h, w, 3)."""
    probability = person_probability(path, picture)
    size = picture.shape[1::-1]
    return np.asarray(cv2.resize(probability, size, interpolation=cv2.INTER_LINEAR) > PERSON)


class MediaPipeJudge:
    """MediaPipe's own programs in an environment of their own.

    python: of that environment.
    """

    name, is_independent = "MediaPipe", True

    def __init__(self, python: Path) -> None:
        self.python = python

    def landmarks(self, pictures: Iterable[Picture]) -> Array:
        """See `Observer`.  Raises `UserError` if the judge fails."""
        found = self._run("landmarks", pictures)
        if found is None:
            return np.full((0, LANDMARK_COUNT, 3), np.nan)
        return found[:, :LANDMARK_COUNT].astype(np.float64)

    def people(self, pictures: Iterable[Picture]) -> Sequence[Mask] | None:
        """See `Observer`.  Raises `UserError` if the judge fails."""
        found = self._run("people", pictures)
        return [] if found is None else list(found.astype(bool))

    def _run(self, task: str, pictures: Iterable[Picture]) -> NDArray[np.generic] | None:
        """What the program says of pictures; None if there are none."""
        remaining = iter(pictures)
        first = next(remaining, None)
        if first is None:
            return None
        program = str(Path(__file__).with_name("mediapipe_program.py"))
        size = str(first.shape[1]), str(first.shape[0])
        frames = (np.ascontiguousarray(each).tobytes() for each in chain([first], remaining))
        found = run_program([str(self.python), program, task, *size], frames, "the judge failed")
        return np.asarray(np.load(BytesIO(found), allow_pickle=False))


def find_observer() -> Observer:
    """The judge if there is one, see `ENVIRONMENT`, else the encoder's own networks.

    Without looking for one it is these if `ENVIRONMENT_VARIABLE` is empty.
    """
    named = os.environ.get(ENVIRONMENT_VARIABLE)
    if named == "":
        return EncoderNetworks()
    if named is not None:
        if not Path(named).is_file():
            raise UserError(f"{ENVIRONMENT_VARIABLE}: there is no {named}; it is a judge's python")
        return MediaPipeJudge(Path(named))
    here = Path(__file__).resolve().parents[2]
    made = next((p for p in (Path(ENVIRONMENT), here / ENVIRONMENT) if p.is_file()), None)
    return EncoderNetworks() if made is None else MediaPipeJudge(made.absolute())


def _tracker() -> LandmarkTracker | None:
    try:
        return open_landmark_tracker()
    except NetworkFilesMissing:
        return None


def _landmarks(tracker: LandmarkTracker | None, picture: Picture) -> Array:
    found = None if tracker is None else tracker.update(picture)
    return np.full((LANDMARK_COUNT, 3), np.nan) if found is None else found.points
