"""Sources of frames: video file, pipe, image sequence, camera, network stream."""

import logging
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import cv2
import numpy as np

from encoder.capture.frame_times import (
    DEFAULT_FPS,
    FrameTimes,
    exact_fps,
    frame_times,
    is_usable_fps,
)
from encoder.capture.image_sequence import ImageSequence, pattern_and_rate
from encoder.capture.video_file import VideoFile
from protocol.sample_aspect import source_size
from shared_model.arrays import Picture
from shared_model.errors import UserError

_log = logging.getLogger(__name__)


# Names of standard input.
STANDARD_INPUT = ("-", "/dev/stdin")
DEVICES = Path("/dev")


class Reader(Protocol):
    """Reads frames one by one; `read` returns None at the end.

    notes: one line for each thing about the frames read so far that a user should know.
    """

    @property
    def notes(self) -> list[str]: ...

    def read(self) -> Picture | None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class VideoFormat:
    """What the pictures of a source are, see `Capture`."""

    width: int
    height: int
    fps: Fraction
    colour_matrix: str
    sample_aspect: Fraction = Fraction(1)

    @property
    def source_size(self) -> tuple[int, int]:
        """Width and height of the source, if the pictures have square pixels."""
        return source_size(self.width, self.height, self.sample_aspect)


class Capture:
    """An open source of frames of one size; a context manager that can be iterated once.

    width, height: pixels, of the frames as delivered (after rotation metadata).
    times: the frame rate, and when each frame is shown if the rate varies.
    frame_count: number of frames according to the container; None if it is not known.
    is_live: whether frames arrive in real time and without a known end.
    colour_matrix: of a file's Y'CbCr, see `protocol.call_parameters.CallParameters`.
    is_fps_assumed: whether the source states no usable frame rate, so that it is a default.
    sample_aspect: width of a pixel of the source over its height.
    """

    def __init__(
        self,
        name: str,
        reader: Reader,
        times: FrameTimes,
        frame_count: int | None,
        is_live: bool,
        colour_matrix: str = "bt601",
        is_fps_assumed: bool = False,
        sample_aspect: Fraction = Fraction(1),
    ) -> None:
        self.name, self.times, self.frame_count, self.is_live = name, times, frame_count, is_live
        self.colour_matrix, self.is_fps_assumed = colour_matrix, is_fps_assumed
        self.sample_aspect = sample_aspect
        self._reader = reader
        self._first = reader.read()
        if self._first is None:
            reader.close()
            raise UserError(f"{name} has no readable frame; check that it is a video")
        self.height, self.width = self._first.shape[:2]

    @property
    def fps(self) -> Fraction:
        """Exact frame rate, frames per second; the mean of one that varies."""
        return self.times.fps

    @property
    def format(self) -> VideoFormat:
        """Of the frames as delivered."""
        matrix = self.colour_matrix
        return VideoFormat(self.width, self.height, self.fps, matrix, self.sample_aspect)

    @property
    def notes(self) -> list[str]:
        """See `Reader`."""
        notes = list[str]()
        if self.is_fps_assumed:
            rate = f"{float(self.fps):g} frames a second"
            notes.append(f"{self.name} states no usable frame rate: taken as {rate}")
        return notes + self._reader.notes

    def __iter__(self) -> Iterator[tuple[int, Picture]]:
        """Yield (index, frame): frame (height, width, 3) uint8, BGR.

        Raises `UserError` where the size of the frames changes.
        """
        index, frame, self._first = 0, self._first, None
        while frame is not None:
            if frame.shape != (self.height, self.width, 3):
                raise UserError(
                    f"{self.name}: frame {index} is {frame.shape[1]}x{frame.shape[0]} but the first"
                    f" was {self.width}x{self.height}; convert it to one size first"
                )
            yield index, frame
            index, frame = index + 1, self._reader.read()

    def drop_frames_while(
        self, busy: Callable[[], bool], look: Callable[[Picture], None] = lambda picture: None
    ) -> None:
        """Drop the frames that arrive while `busy()`; iteration starts with the first one after.

        look: called with each that is dropped.
        """
        while busy() and (frame := self._reader.read()) is not None:
            self._first = frame
            look(frame)

    def close(self) -> None:
        """Release the device or file."""
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def open_source(source: str, square_pixels: bool = False) -> Capture:
    """Open a video file, an image sequence pattern (frame_%04d.png), a camera index or a URL.

    A pattern may end with its rate, frames per second: frame_%04d.png@30, @30000/1001.
    Also a pipe, or "-" for standard input: it is read as it comes, and once only.
    square_pixels: pictures whose pixels are not square are stretched, see `sample_aspect`.
    Raises `UserError`, one line, if there is nothing to read.
    """
    if not source:
        raise UserError("the name of the source is empty; give a video file or a camera's number")
    if source.isdecimal():
        camera = CameraReader(int(source))
        rate = FrameTimes(exact_fps(camera.stated_fps))
        is_assumed = not is_usable_fps(camera.stated_fps)
        return Capture(source, camera, rate, None, True, is_fps_assumed=is_assumed)
    if "://" in source and not source.startswith("file://"):
        video = VideoFile(source, source, True, False, square_pixels)
        return _video_capture(source, video, is_live=video.frame_count is None)
    path = Path(source.removeprefix("file://"))
    pattern, stated_rate = pattern_and_rate(str(path))
    if "%" in Path(pattern).name and not path.exists():
        return _open_images(pattern, stated_rate)
    if is_pipe(source):
        name, address = _pipe_names(source)
        return _video_capture(name, VideoFile(name, address, False, False, square_pixels))
    _check_file(path)
    return _video_capture(str(path), VideoFile(str(path), str(path), False, True, square_pixels))


def is_pipe(source: str) -> bool:
    """Whether a source can be read only once: standard input, or a named pipe."""
    path = Path(source.removeprefix("file://"))
    return (source in STANDARD_INPUT and not path.is_file()) or path.is_fifo()


def _pipe_names(source: str) -> tuple[str, str]:
    """The name of a pipe for messages, and its address for FFmpeg."""
    if source in STANDARD_INPUT:
        return "standard input", "pipe:0"
    path = source.removeprefix("file://")
    return path, path


def _open_images(pattern: str, rate: str | None) -> Capture:
    fps = DEFAULT_FPS if rate is None else Fraction(rate)
    if not is_usable_fps(float(fps)):
        raise UserError(f"{pattern}@{rate}: a rate is 1 to 240 frames a second")
    images = ImageSequence(Path(pattern))
    return Capture(pattern, images, FrameTimes(fps), images.frame_count, is_live=False)


def _check_file(path: Path) -> None:
    """Raise `UserError` if a file cannot be opened."""
    if not path.exists():
        raise UserError(f"cannot read {path}: no such file")
    if path.is_dir():
        raise UserError(f"{path} is a folder; give a pattern such as {path}/frame_%04d.png")
    if not os.access(path, os.R_OK):
        raise UserError(f"cannot read {path}: no permission")


def _video_capture(name: str, video: VideoFile, is_live: bool = False) -> Capture:
    times = frame_times(video.time_stamps.times_s, exact_fps(video.stated_fps))
    # Without a rate a container may still have times.
    is_assumed = not is_usable_fps(video.stated_fps) and times == FrameTimes(DEFAULT_FPS)
    matrix, aspect = video.colour_matrix, video.sample_aspect
    _log.info("%s: %.2f frames a second, sample aspect %s", name, times.fps, aspect)
    return Capture(name, video, times, video.frame_count, is_live, matrix, is_assumed, aspect)


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
