"""Where decoded pictures go: a video file or a sequence of image files."""

from fractions import Fraction
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from shared_model.errors import UserError

Picture = NDArray[np.uint8]

# Container -> codec.  FFV1 is lossless.
CODECS = {".mkv": "FFV1", ".avi": "FFV1", ".mp4": "mp4v", ".mov": "mp4v"}
# Matroska's DefaultDuration element with a four-byte value, ns a frame.
MKV_DEFAULT_DURATION = b"\x23\xe3\x83\x84"
MKV_HEADER_BYTES = 4096
# Pictures that may wait for a `Background` sink.
QUEUED_PICTURES = 4


class PictureSink(Protocol):
    """Takes the pictures of one call in order."""

    def write(self, picture: Picture) -> None:
        """Add one picture, (height, width, 3) uint8 BGR."""

    def close(self) -> None:
        """Finish the files; what was written is kept."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block, whatever happened in it."""

    def __exit__(self, *exception: object) -> None:
        """Close."""


def open_sink(path: Path, width: int, height: int, fps: Fraction) -> PictureSink:
    """The sink that `path` asks for: .mkv (lossless), .avi, .mp4, or images such as out/%04d.png.

    Raises `UserError` if there is no such kind or it cannot be written.
    """
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: there is no folder {path.parent}")
    if "%" in path.name:
        return ImageSequence(path)
    if path.suffix.lower() not in CODECS:
        known = " ".join(sorted(CODECS))
        raise UserError(f"cannot write {path}: name it {known} or, for images, like frame%04d.png")
    return VideoFile(path, width, height, fps)


def padding_px(path: Path, width: int, height: int) -> tuple[int, int]:
    """Rows and columns that a sink at `path` adds below and to the right of a picture."""
    return (0, 0) if "%" in path.name else (height % 2, width % 2)


class VideoFile:
    """Writes a video file; it stands under a temporary name until it is finished.

    OpenCV writes even sizes only: the edge of an odd picture is repeated once (see `padding_px`).
    Leaving the `with` block by an exception finishes it too, so that a stopped recording plays.
    Nothing is left behind if nothing was written.
    """

    def __init__(self, path: Path, width: int, height: int, fps: Fraction) -> None:
        self._path, self._fps, self._shape = path, fps, (height, width, 3)
        bottom, right = padding_px(path, width, height)
        self._border = (0, bottom, 0, right, cv2.BORDER_REPLICATE) if bottom or right else None
        self._part = path.with_name(f"{path.stem}.part{path.suffix}")
        self._written = 0
        code = cv2.VideoWriter_fourcc(*CODECS[path.suffix.lower()])  # type: ignore[attr-defined]
        self._writer = cv2.VideoWriter(
            str(self._part), cv2.CAP_FFMPEG, code, float(fps), (width + right, height + bottom)
        )
        if not self._writer.isOpened():
            self._part.unlink(missing_ok=True)
            raise UserError(f"cannot write {path}: no place, no permission or no such codec")

    def write(self, picture: Picture) -> None:
        """Add one picture.  Raises `ValueError` if it is of another size."""
        if picture.shape != self._shape:
            raise ValueError(f"picture has shape {picture.shape}, expected {self._shape}")
        if self._border is not None:
            picture = np.asarray(cv2.copyMakeBorder(picture, *self._border), dtype=np.uint8)
        self._writer.write(picture)
        self._written += 1

    def close(self) -> None:
        """Finish the file and put it in its place; closing twice does nothing more."""
        if not self._writer.isOpened():
            return
        self._writer.release()
        if not self._written:
            self._part.unlink(missing_ok=True)
            return
        if self._path.suffix.lower() == ".mkv":
            _state_exact_rate(self._part, self._fps)
        self._part.replace(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Background:
    """Writes into another sink from a thread of its own, so that drawing need not wait for coding.

    What goes wrong there is raised by the next `write` or by `close`.
    """

    def __init__(self, sink: PictureSink) -> None:
        self._sink = sink
        self._error: BaseException | None = None
        self._queue: Queue[Picture | None] = Queue(QUEUED_PICTURES)
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    def write(self, picture: Picture) -> None:
        """Hand over one picture, which must not change any more; waits if many are waiting."""
        self._raise_error()
        self._queue.put(picture)

    def close(self) -> None:
        """Write what is waiting and finish; closing twice does nothing more."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._sink.close()
        self._raise_error()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
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
            raise UserError(f"cannot write {path}: no place or no permission")
        self._count += 1

    def close(self) -> None:
        """Nothing is open between two images."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _state_exact_rate(path: Path, fps: Fraction) -> None:
    """Correct the frame duration in a Matroska header: OpenCV writes 2997/100 for 30000/1001."""
    with path.open("r+b") as file:
        place = file.read(MKV_HEADER_BYTES).find(MKV_DEFAULT_DURATION)
        if place >= 0:
            file.seek(place + len(MKV_DEFAULT_DURATION))
            file.write(round(1_000_000_000 / fps).to_bytes(4, "big"))
