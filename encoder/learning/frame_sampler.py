"""Uniform subsampling of the frames of a source of unknown length."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

# The fewest frames of a longer source that a person model is built from.
TRAINING_FRAMES = 64


class UniformSubsampler:
    """Keeps every 2^k-th frame of a source, `min_frames` to twice as many once there are so many.

    frames: (index, picture) of the frames kept so far.
    """

    def __init__(self, min_frames: int = TRAINING_FRAMES) -> None:
        self._min_frames, self._stride = min_frames, 1
        self.frames: list[tuple[int, Picture]] = []

    def offer(self, index: int, make_picture: Callable[[], Picture]) -> None:
        """Offer frame `index`, counted from 0 without a gap.

        make_picture: returns the picture to keep; called only if the frame is kept.
        """
        if index % self._stride:
            return
        self.frames.append((index, make_picture()))
        if len(self.frames) >= 2 * self._min_frames:
            self._stride *= 2
            self.frames = [frame for frame in self.frames if frame[0] % self._stride == 0]
