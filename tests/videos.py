"""Videos that tests write and read."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from threading import Event, Thread

import cv2
import numpy as np

from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from shared_model.arrays import Picture

ENDLESS_FPS = 5


def copy_frames(source: Path, target: Path, count: int, matrix: str = "bt601") -> None:
    """Write the first frames of a video as a video of its own."""
    with (
        open_source(str(source)) as capture,
        open_sink(target, capture.width, capture.height, capture.fps, matrix) as sink,
    ):
        for _, frame in islice(capture, count):
            sink.write(frame)


def read_frames(path: Path) -> list[Picture]:
    """All pictures of a video, (height, width, 3) uint8 BGR."""
    with open_source(str(path)) as capture:
        return [np.asarray(frame, np.uint8) for _, frame in capture]


class EndlessVideo:
    """A pipe with the pictures of a video over and over again, until `end` is called.

    What reads it has not come to its end before a test is ready, however slow the test is; at its
    own rate, which is low: what is encoded and drawn while other programs start is of no use.
    count: pictures that have been written.
    """

    def __init__(self, source: Path, pipe: Path) -> None:
        with open_source(str(source)) as capture:
            size = capture.width, capture.height
            self._frames = [cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420) for _, frame in capture]
        self._head = b"YUV4MPEG2 W%d H%d F%d:1 Ip A1:1 C420jpeg\n" % (*size, ENDLESS_FPS)
        self.path, self.count, self._ending = pipe, 0, Event()
        os.mkfifo(pipe)

    def end(self) -> None:
        """The picture that is being written is the last one."""
        self._ending.set()

    def write(self) -> None:
        """Write until the end, or until nobody reads any more."""
        with suppress(BrokenPipeError), self.path.open("wb") as pipe:
            pipe.write(self._head)
            while not self._ending.is_set():
                pipe.write(b"FRAME\n" + self._frames[self.count % len(self._frames)].tobytes())
                self.count += 1


@contextmanager
def endless_video(source: Path, pipe: Path) -> Iterator[EndlessVideo]:
    """That of a video, ended with the `with` block."""
    video = EndlessVideo(source, pipe)
    # If nobody ever reads it waits for ever.
    Thread(target=video.write, daemon=True).start()
    try:
        yield video
    finally:
        video.end()
