"""Sources of frames that OpenCV opens: video file, image sequence, camera, network stream."""

import math
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from encoder.capture.frame_times import (
    DEFAULT_FPS,
    FrameTimes,
    exact_fps,
    frame_times,
    is_usable_fps,
)
from shared_model.errors import UserError

Frame = NDArray[np.uint8]

_OPEN_TIMEOUT_MS = 10_000
# FFmpeg's number of the colour matrix BT.709, as in ITU-T H.273.
_BT709 = 1
_NUMBER_FIELD = re.compile(r"%0?\d*d")


class _Reader(Protocol):
    """Reads frames one by one; `read` returns None at the end."""

    def read(self) -> Frame | None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class VideoFormat:
    """Size and frame rate of a source, see `Capture`."""

    width: int
    height: int
    fps: Fraction
    colour_matrix: str


class Capture:
    """An open source of frames of one size; a context manager that can be iterated once.

    width, height: pixels, of the frames as delivered (after rotation metadata).
    times: the frame rate, and when each frame is shown if the rate varies.
    frame_count: number of frames according to the container; None if it is not known.
    is_live: whether frames arrive in real time and without a known end.
    colour_matrix: of a file's Y'CbCr, see `protocol.packets.CallParameters`.
    is_fps_assumed: whether the source states no usable frame rate, so that it is a default.
    """

    def __init__(
        self,
        name: str,
        reader: _Reader,
        times: FrameTimes,
        frame_count: int | None,
        is_live: bool,
        colour_matrix: str = "bt601",
        is_fps_assumed: bool = False,
    ) -> None:
        self.name, self.times, self.frame_count, self.is_live = name, times, frame_count, is_live
        self.colour_matrix, self.is_fps_assumed = colour_matrix, is_fps_assumed
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
        """Size and rate of the frames."""
        return VideoFormat(self.width, self.height, self.fps, self.colour_matrix)

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
    if not source:
        raise UserError("the name of the source is empty; give a video file or a camera's number")
    path = Path(source.removeprefix("file://"))
    if source == "-" and not path.exists():
        raise UserError("a source is not read from standard input; give the name of a file")
    if "%" in path.name and not path.exists():
        return _open_sequence(path)
    if not path.exists():
        raise UserError(f"cannot read {path}: no such file")
    if path.is_dir():
        raise UserError(f"{path} is a folder; give a pattern such as {path}/frame_%04d.png")
    if not os.access(path, os.R_OK):
        raise UserError(f"cannot read {path}: no permission")
    video = cv2.VideoCapture(str(path))
    return _open_video(str(path), video, "{} is not a video OpenCV can read", *read_tags(path))


def read_tags(path: Path) -> tuple[str, tuple[Fraction, ...]]:
    """What OpenCV does not tell of a video file: colour matrix, and times of all frames in seconds.

    The matrix is that of the tag: bt709 or bt601; bt601 also for files without a tag or with
    another matrix, for pipes and for devices.  OpenCV converts BT.2020 pictures to the RGB of
    BT.709 by itself.  The times are empty where the container has not all of them.
    """
    # A pipe or device can be read only once.
    if not path.is_file():
        return "bt601", ()
    try:
        with av.open(str(path), metadata_errors="ignore") as container:
            if not container.streams.video:
                return "bt601", ()
            stream = container.streams.video[0]
            context = stream.codec_context
            matrix = "bt709" if context and context.colorspace == _BT709 else "bt601"
            return matrix, _times_s(container, stream)
    except av.FFmpegError:
        return "bt601", ()


def _times_s(container: InputContainer, stream: VideoStream) -> tuple[Fraction, ...]:
    """The presentation times of a stream's frames, seconds, in coding order; or none."""
    times_s: list[Fraction] = []
    for packet in container.demux(stream):
        if not packet.size or packet.is_discard:
            continue
        if packet.pts is None or packet.time_base is None:
            return ()
        times_s.append(packet.pts * packet.time_base)
    return tuple(times_s)


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
    name: str,
    video: cv2.VideoCapture,
    error_text: str,
    colour_matrix: str = "bt601",
    times_s: tuple[Fraction, ...] = (),
) -> Capture:
    if not video.isOpened():
        raise UserError(error_text.format(name))
    is_remote = name.isdecimal() or "://" in name
    if name.isdecimal():
        # A queue in the driver adds latency.
        video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    count = video.get(cv2.CAP_PROP_FRAME_COUNT)
    frame_count = int(count) if math.isfinite(count) and 0 < count < 2**31 else None
    stated_fps = video.get(cv2.CAP_PROP_FPS)
    times = frame_times(times_s, exact_fps(stated_fps))
    # Without a rate a container may still have times.
    is_assumed = not is_usable_fps(stated_fps) and times == FrameTimes(DEFAULT_FPS)
    is_live = is_remote and frame_count is None
    reader = _VideoReader(video)
    return Capture(
        name, reader, times, len(times_s) or frame_count, is_live, colour_matrix, is_assumed
    )


def _open_sequence(pattern: Path) -> Capture:
    """Read numbered images, the lowest number first, at the default rate."""
    paths = _sequence_paths(pattern)
    times = FrameTimes(DEFAULT_FPS)
    return Capture(str(pattern), _SequenceReader(paths), times, len(paths), is_live=False)


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
