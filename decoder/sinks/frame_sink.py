"""Where decoded pictures go: a video file, a sequence of image files, or a raw stream."""

from fractions import Fraction
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import BinaryIO, Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.sinks.video_file import CODECS, VideoFile
from decoder.sinks.y4m_stream import Y4mStream
from shared_model.errors import UserError

Picture = NDArray[np.uint8]

# Pictures that may wait for a `ThreadedSink`.
MAX_QUEUED_PICTURES = 4


class FrameSink(Protocol):
    """Takes the pictures of one call in order."""

    def write(self, picture: Picture) -> None:
        """Add one picture, (height, width, 3) uint8 BGR."""

    def mark_incomplete(self) -> Path | None:
        """Say that the call goes on after these pictures: an older file of the same name stays.

        Returns where the pictures will be instead; None: under their own name.
        """

    def close(self) -> None:
        """Finish the files; what was written is kept."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block, whatever happened in it."""

    def __exit__(self, *exception: object) -> None:
        """Close; after an exception the pictures are incomplete."""


def open_sink(
    path: Path | BinaryIO, width: int, height: int, fps: Fraction, matrix: str = "bt601"
) -> FrameSink:
    """The sink that `path` asks for: .mkv, .avi, .mp4, .mov, or images such as out/%04d.png.

    An open stream gets YUV4MPEG2.

    matrix: of the source, see `CallParameters`.  The pictures of bt601 stand in .mkv losslessly, as
    RGB; those of another as that matrix' Y'CbCr in 8 bits, tagged with it, so that a comparison of
    planes, or a reader that knows no tags, treats the file as it does the source.  .avi, which has
    no place for a tag, is always RGB.
    Raises `UserError` if there is no such kind or it cannot be written, `ValueError` for another
    matrix.
    """
    if not isinstance(path, Path):
        return Y4mStream(path, width, height, fps, matrix)
    check_sink(path)
    if "%" in path.name:
        return ImageSequence(path)
    return VideoFile(path, width, height, fps, matrix)


def check_sink(path: Path) -> None:
    """Raise `UserError` if there is no sink that `path` could ask for, before there is a call."""
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: there is no folder {path.parent}")
    if "%" in path.name:
        ImageSequence(path)
    elif path.suffix.lower() not in CODECS:
        known = " ".join(sorted(CODECS))
        raise UserError(f"cannot write {path}: name it {known} or, for images, like frame%04d.png")


class ThreadedSink:
    """Writes into another sink from a thread of its own, so that drawing need not wait for coding.

    What goes wrong there is raised by the next `write` or by `close`.
    """

    def __init__(self, sink: FrameSink) -> None:
        self._sink = sink
        self._error: BaseException | None = None
        self._queue: Queue[Picture | None] = Queue(MAX_QUEUED_PICTURES)
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    def write(self, picture: Picture) -> None:
        """Hand over one picture, which must not change any more; waits if many are waiting."""
        self._raise_error()
        self._queue.put(picture)

    def mark_incomplete(self) -> Path | None:
        """See `PictureSink`."""
        return self._sink.mark_incomplete()

    def close(self) -> None:
        """Write what is waiting and finish; closing twice does nothing more."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        if self._error is not None:
            self._sink.mark_incomplete()
        self._sink.close()
        self._raise_error()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if any(exception):
            self.mark_incomplete()
        self.close()

    def _work(self) -> None:
        while (picture := self._queue.get()) is not None:
            if self._error is None:
                try:
                    self._sink.write(picture)
                except Exception as error:  # passed on to the other thread, whatever it is
                    self._error = error

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error


class ImageSequence:
    """Writes each picture to a file of its own, numbered from 0 like the source's frames."""

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

    def write(self, picture: Picture) -> None:
        """Write the next image.  Raises `UserError` if the disk refuses."""
        path = self._pattern.with_name(self._pattern.name % self._count)
        if not cv2.imwrite(str(path), picture):
            raise UserError(f"cannot write {path}: no space or no permission")
        self._count += 1

    def mark_incomplete(self) -> Path | None:
        """See `PictureSink`: each image has replaced an older one already."""
        return None

    def close(self) -> None:
        """Nothing is open between two images."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
