"""Where decoded pictures go: a video file, a sequence of image files, or a raw stream."""

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import BinaryIO

import cv2

from decoder.sinks.interface import FrameSink
from decoder.sinks.video_file import CODECS, TIMED, VideoFileSink
from decoder.sinks.y4m_stream import Y4mStream
from shared_model.arrays import Picture, Samples
from shared_model.errors import UserError, cannot_write

# Pictures and pieces of sound that may wait for a `ThreadedSink`.
MAX_QUEUED_WRITES = 6


def open_sink(
    path: Path | BinaryIO,
    width: int,
    height: int,
    fps: Fraction,
    matrix: str = "bt601",
    is_variable: bool = False,
    sound_rate_hz: int | None = None,
    sample_aspect: Fraction = Fraction(1),
) -> FrameSink:
    """The sink for `path`: .mkv, .avi, .mp4, .mov, .webm, images such as out/%04d.png, or a stream.

    An open stream gets YUV4MPEG2.
    matrix: colour matrix of the source, see `CallParameters`.  Pictures of bt601 are stored in .mkv
        losslessly, as RGB; others as 8-bit Y'CbCr of their matrix, tagged with it, so that readers
        that ignore tags treat the file as they treat the source.  .avi, which cannot be tagged, is
        always RGB.
    is_variable: pictures have times of their own and `fps` is the mean, see `keeps_times`.
    sound_rate_hz: samples per second of the sound track of a video file; None: it has none.
    sample_aspect: width of a pixel over its height, stated in the file where its kind can.
    Raises `UserError` if the kind of file is unknown or it cannot be written, `ValueError` for an
    unknown matrix.
    """
    if not isinstance(path, Path):
        return Y4mStream(path, width, height, fps, matrix, sample_aspect)
    check_sink(path)
    if "%" in path.name:
        return ImageSequenceSink(path)
    is_timed = is_variable and keeps_times(path)
    size = width, height
    return VideoFileSink(path, *size, fps, matrix, is_timed, sound_rate_hz, sample_aspect)


def keeps_times(output: Path | BinaryIO) -> bool:
    """Whether a sink for `output` keeps the times of pictures; images have none to keep."""
    if not isinstance(output, Path):
        return False
    return "%" in output.name or output.suffix.lower() in TIMED


def check_sink(path: Path) -> None:
    """Raise `UserError` if `open_sink` would refuse `path`."""
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: there is no folder {path.parent}")
    if "%" in path.name:
        ImageSequenceSink(path)
    elif path.suffix.lower() not in CODECS:
        known = " ".join(sorted(CODECS))
        raise UserError(f"cannot write {path}: name it {known} or, for images, like frame%04d.png")


class ThreadedSink(FrameSink):
    """Writes into another sink from a thread of its own, so that drawing does not wait for coding.

    The next `write` or `close` raises the errors of the other sink.
    """

    def __init__(self, sink: FrameSink) -> None:
        self._sink = sink
        self._error: BaseException | None = None
        self._queue: Queue[Callable[[], None] | None] = Queue(MAX_QUEUED_WRITES)
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    def write(self, picture: Picture, time_s: Fraction | None = None) -> None:
        """Queue one picture, which must not change afterwards; waits while the queue is full."""
        self._raise_error()
        self._queue.put(partial(self._sink.write, picture, time_s))

    def write_sound(self, samples: Samples) -> None:
        """Queue samples, which must not change afterwards; waits while the queue is full."""
        self._raise_error()
        if len(samples):
            self._queue.put(partial(self._sink.write_sound, samples))

    def mark_incomplete(self) -> Path | None:
        """See `FrameSink`."""
        return self._sink.mark_incomplete()

    def close(self) -> None:
        """Write the queued pictures and finish; closing twice has no further effect."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        if self._error is not None:
            self._sink.mark_incomplete()
        self._sink.close()
        self._raise_error()

    def _work(self) -> None:
        while (write := self._queue.get()) is not None:
            if self._error is None:
                try:
                    write()
                except Exception as error:  # passed on to the other thread, whatever it is
                    self._error = error

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error


class ImageSequenceSink(FrameSink):
    """Writes each picture to a file of its own, numbered from 0, in place of an older one.

    Images have no sound.
    """

    def __init__(self, path: Path) -> None:
        self._pattern = path
        self._count = 0
        try:
            first = path.name % 0
        except (TypeError, ValueError) as error:
            raise UserError(f"cannot write {path}: number the images like frame%04d.png") from error
        if not cv2.haveImageWriter(first):
            raise UserError(
                f"cannot write {path}: no image format {path.suffix or 'without suffix'}"
            )

    def write(self, picture: Picture, time_s: Fraction | None = None) -> None:
        """Write the next image.  Raises `UserError` if the disk refuses."""
        path = self._pattern.with_name(self._pattern.name % self._count)
        # Not by OpenCV, which does not say why it cannot.
        done, image = cv2.imencode(path.suffix, picture)
        if not done:
            raise UserError(f"cannot write {path}: no such picture in this format")
        try:
            path.write_bytes(image.tobytes())
        except OSError as error:
            raise cannot_write(path, error) from error
        self._count += 1
