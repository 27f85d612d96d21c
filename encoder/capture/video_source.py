"""Sources of frames that OpenCV opens: video file, image sequence, camera, network stream."""

import math
import os
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from shared_model.errors import UserError

Frame = NDArray[np.uint8]

DEFAULT_FPS = Fraction(25)
_OPEN_TIMEOUT_MS = 10_000
# FFmpeg's number of the colour matrix BT.709, as in ITU-T H.273.
_BT709 = 1
_NUMBER_FIELD = re.compile(r"%0?\d*d")


class _Reader(Protocol):
    """Reads frames one by one; `read` returns None at the end."""

    def read(self) -> Frame | None: ...

    def close(self) -> None: ...


class Capture:
    """An open source of frames of one size; a context manager that can be iterated once.

    width, height: pixels, of the frames as delivered (after rotation metadata).
    fps: exact frame rate, frames per second.
    frame_count: number of frames according to the container; None if it is not known.
    is_live: whether frames arrive in real time and without a known end.
    colour_matrix: of a file's Y'CbCr, see `protocol.packets.CallParameters`.
    is_fps_assumed: whether the source states no usable frame rate, so that `fps` is a default.
    """

    def __init__(
        self,
        name: str,
        reader: _Reader,
        fps: Fraction,
        frame_count: int | None,
        is_live: bool,
        colour_matrix: str = "bt601",
        is_fps_assumed: bool = False,
    ) -> None:
        self.name, self.fps, self.frame_count, self.is_live = name, fps, frame_count, is_live
        self.colour_matrix, self.is_fps_assumed = colour_matrix, is_fps_assumed
        self._reader = reader
        self._first = reader.read()
        if self._first is None:
            reader.close()
            raise UserError(f"{name} has no readable frame; check that it is a video")
        self.height, self.width = self._first.shape[:2]

    def __iter__(self) -> Iterator[tuple[int, Frame]]:
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

    def drop_frames_while(self, busy: Callable[[], bool]) -> None:
        """Drop the frames that arrive while `busy()`; iteration starts with the first one after."""
        while busy() and (frame := self._reader.read()) is not None:
            self._first = frame

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


class _VideoReader:
    """Frames of a `cv2.VideoCapture`."""

    def __init__(self, video: cv2.VideoCapture) -> None:
        self._video = video

    def read(self) -> Frame | None:
        ok, frame = self._video.read()
        return np.asarray(frame, dtype=np.uint8) if ok else None

    def close(self) -> None:
        self._video.release()


class _SequenceReader:
    """Frames from image files."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = iter(paths)

    def read(self) -> Frame | None:
        path = next(self._paths, None)
        if path is None:
            return None
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise UserError(f"{path} is not a readable image")
        return np.asarray(image, dtype=np.uint8)

    def close(self) -> None:
        pass


def open_source(source: str) -> Capture:
    """Open a video file, an image sequence pattern (frame_%04d.png), a camera index or a URL.

    Raises `UserError`, one line, if there is nothing to read.
    """
    _silence_opencv()
    if source.isdecimal():
        return _open_video(source, cv2.VideoCapture(int(source)), "camera {} does not open")
    if "://" in source and not source.startswith("file://"):
        return _open_stream(source)
    path = Path(source.removeprefix("file://"))
    if "%" in path.name and not path.exists():
        return _open_sequence(path)
    if not path.exists():
        raise UserError(f"cannot read {path}: no such file")
    if path.is_dir():
        raise UserError(f"{path} is a folder; give a pattern such as {path}/frame_%04d.png")
    if not os.access(path, os.R_OK):
        raise UserError(f"cannot read {path}: no permission")
    video = cv2.VideoCapture(str(path))
    return _open_video(
        str(path), video, "{} is not a video OpenCV can read", tagged_colour_matrix(path)
    )


def is_usable_fps(fps: float) -> bool:
    """Whether a stated frame rate is plausible."""
    return math.isfinite(fps) and 1 <= fps <= 240


def exact_fps(fps: float) -> Fraction:
    """The exact rate of a rounded one (29.97 -> 30000/1001); 25 if it is not usable."""
    if not is_usable_fps(fps):
        return DEFAULT_FPS
    for denominator in (1, 1001):
        numerator = round(fps * denominator / 1000) * 1000 if denominator > 1 else round(fps)
        if abs(numerator / denominator - fps) < 0.004:
            return Fraction(numerator, denominator)
    return Fraction(fps).limit_denominator(1001)


def tagged_colour_matrix(path: Path) -> str:
    """The colour matrix of a video file's Y'CbCr according to its tag: bt709 or bt601.

    bt601 also for files without a tag or with another matrix, for pipes and for devices.
    OpenCV converts BT.2020 pictures to the RGB of BT.709 by itself.
    """
    # A pipe or device can be read only once.
    if not path.is_file():
        return "bt601"
    try:
        with av.open(str(path), metadata_errors="ignore") as container:
            streams = container.streams.video
            context = streams[0].codec_context if streams else None
            return "bt709" if context and context.colorspace == _BT709 else "bt601"
    except av.FFmpegError:
        return "bt601"


def _silence_opencv() -> None:
    """Stop FFmpeg and OpenCV from writing to the terminal: `UserError` says it in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def _open_stream(url: str) -> Capture:
    options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_TIMEOUT_MS]
    options += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, _OPEN_TIMEOUT_MS]
    video = cv2.VideoCapture(url, cv2.CAP_FFMPEG, options)
    return _open_video(url, video, "{} does not answer or is not a video stream")


def _open_video(
    name: str, video: cv2.VideoCapture, error_text: str, colour_matrix: str = "bt601"
) -> Capture:
    if not video.isOpened():
        raise UserError(error_text.format(name))
    is_remote = name.isdecimal() or "://" in name
    if name.isdecimal():
        # A queue in the driver adds latency.
        video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    count = video.get(cv2.CAP_PROP_FRAME_COUNT)
    frame_count = int(count) if math.isfinite(count) and 0 < count < 2**31 else None
    fps = video.get(cv2.CAP_PROP_FPS)
    is_live = is_remote and frame_count is None
    reader, is_assumed = _VideoReader(video), not is_usable_fps(fps)
    return Capture(name, reader, exact_fps(fps), frame_count, is_live, colour_matrix, is_assumed)


def _open_sequence(pattern: Path) -> Capture:
    """Read numbered images, the lowest number first, at the default rate."""
    paths = _sequence_paths(pattern)
    return Capture(str(pattern), _SequenceReader(paths), DEFAULT_FPS, len(paths), is_live=False)


def _sequence_paths(pattern: Path) -> list[Path]:
    fields = _NUMBER_FIELD.findall(pattern.name)
    if len(fields) != 1 or pattern.name.count("%") != 1:
        raise UserError(f"{pattern}: a sequence pattern has one number, such as frame_%04d.png")
    before, after = pattern.name.split(fields[0])
    shape = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    matches = map(shape.fullmatch, os.listdir(pattern.parent) if pattern.parent.is_dir() else [])
    numbers = sorted({int(m[1]) for m in matches if m and pattern.name % int(m[1]) == m[0]})
    if not numbers:
        raise UserError(f"{pattern}: no file matches this pattern")
    for expected, number in enumerate(numbers, start=numbers[0]):
        if number != expected:
            raise UserError(
                f"{pattern.parent / (pattern.name % expected)} is missing in the sequence"
            )
    return [pattern.parent / (pattern.name % number) for number in numbers]
