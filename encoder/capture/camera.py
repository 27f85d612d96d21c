"""Frames of a camera of this host, read by OpenCV."""

import os
from pathlib import Path

import cv2
import numpy as np

from shared_model.arrays import Picture
from shared_model.errors import UserError

DEVICES = Path("/dev")


def why_not_opened(number: int, devices: Path = DEVICES) -> str:
    """Why a camera of this host does not open, and what else there is.  devices: their folder."""
    names = [each.name.removeprefix("video") for each in devices.glob("video*")]
    there = sorted(int(name) for name in names if name.isdecimal())
    if not there:
        return "there is no camera on this host"
    if number not in there:
        return f"there is none of this number; there are {', '.join(map(str, there))}"
    if not os.access(devices / f"video{number}", os.R_OK | os.W_OK):
        return "no permission; is this user in the group `video`?"
    return "it gives no pictures; another program may use it"


class CameraReader:
    """An open camera.  stated_fps: by its driver.  Raises `UserError` if it does not open."""

    def __init__(self, number: int) -> None:
        # What OpenCV and its FFmpeg write to the terminal is said in one line.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._video = cv2.VideoCapture(number)
        if not self._video.isOpened():
            raise UserError(f"camera {number} does not open: {why_not_opened(number)}")
        # A queue in the driver adds latency.
        self._video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self.stated_fps = float(self._video.get(cv2.CAP_PROP_FPS))

    @property
    def notes(self) -> list[str]:
        """See `Reader`: there are none."""
        return []

    def read(self) -> Picture | None:
        """The next picture (h, w, 3) uint8 BGR; None when it gives none any more."""
        ok, frame = self._video.read()
        return np.asarray(frame, dtype=np.uint8) if ok else None

    def close(self) -> None:
        """Release the device."""
        self._video.release()
