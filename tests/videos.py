"""Videos that tests write and read."""

from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source


def copy_frames(source: Path, target: Path, count: int, matrix: str = "bt601") -> None:
    """Write the first frames of a video as a video of its own."""
    with (
        open_source(str(source)) as capture,
        open_sink(target, capture.width, capture.height, capture.fps, matrix) as sink,
    ):
        for _, frame in islice(capture, count):
            sink.write(frame)


def read_frames(path: Path) -> list[NDArray[np.uint8]]:
    """All pictures of a video, (height, width, 3) uint8 BGR."""
    with open_source(str(path)) as capture:
        return [np.asarray(frame, np.uint8) for _, frame in capture]
