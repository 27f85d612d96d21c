"""The first model of a call, made of what the camera shows while nobody has come yet.

Whoever comes then sees a face sooner, by the time that finding it and training take.
"""

import time
from collections.abc import Callable

from encoder.calls.face_search import open_landmark_search
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import Capture, open_source
from encoder.detection.iris import WIDE_CROP_SCALE
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from shared_model.arrays import Picture

# From one look at the camera to the next: whoever leaves takes the model along.  And from one model
# to the next, of the same face where it is now, in the light of now: it takes .7 s of one core.
LOOK_INTERVAL_S, REFRESH_INTERVAL_S = 1.0, 10.0


class EarlyModelMaker:
    """Looks at a source before its frames are encoded.

    Its models are progressive.
    clock: seconds from any origin.
    Raises `UserError` if the networks are missing.
    """

    def __init__(self, trainers: CallTrainers, clock: Callable[[], float] = time.monotonic) -> None:
        self._trainers, self._clock = trainers, clock
        # With the eyes of a live call, but there is time for the whole picture at once.
        self._search = open_landmark_search(SessionStats(), eye_crop_scale=WIDE_CROP_SCALE)
        self._model: FirstModel | None = None
        self._next_look_s = self._next_model_s = float("-inf")

    @property
    def model(self) -> FirstModel | None:
        """Of one of the newest pictures; None if the newest that was looked at shows no face."""
        return self._model

    def watch(self, capture: Capture, busy: Callable[[], bool]) -> None:
        """Drop the frames of a camera while `busy()`, and look at some of them."""
        capture.drop_frames_while(busy, self._look_if_due)

    def read(self, source: str, busy: Callable[[], bool]) -> None:
        """Look at the frames of a file, opened for that alone, up to the first face."""
        with open_source(source, square_pixels=True) as capture:
            for _, picture in capture:
                self._look(picture)
                if self._model is not None or not busy():
                    return

    def _look_if_due(self, picture: Picture) -> None:
        if self._clock() >= self._next_look_s:
            self._look(picture)
            self._next_look_s = self._clock() + LOOK_INTERVAL_S

    def _look(self, picture: Picture) -> None:
        found = self._search.find(picture, None) if picture.size else None
        if found is None:
            self._model = None
        elif self._model is None or self._clock() >= self._next_model_s:
            self._model = self._trainers.first_model([picture.copy()], [found.points], True)
            self._next_model_s = self._clock() + REFRESH_INTERVAL_S
