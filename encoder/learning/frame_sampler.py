"""Uniform subsampling of the frames of a source of unknown length."""

from collections.abc import Callable
from typing import Generic, TypeVar

Kept = TypeVar("Kept")

# The fewest frames of a longer source that a person model is built from.
TRAINING_FRAMES = 64


class UniformSubsampler(Generic[Kept]):
    """Keeps every 2^k-th frame of a source, `min_frames` to twice as many once there are so many.

    frames: index and what is kept of each frame so far.
    """

    def __init__(self, min_frames: int = TRAINING_FRAMES) -> None:
        self._min_frames, self._stride = min_frames, 1
        self.frames: list[tuple[int, Kept]] = []

    def offer(self, index: int, make: Callable[[], Kept]) -> None:
        """Offer frame `index`, counted from 0 without a gap.

        make: returns what to keep of the frame; called only if the frame is kept.
        """
        if index % self._stride:
            return
        self.frames.append((index, make()))
        if len(self.frames) >= 2 * self._min_frames:
            self._stride *= 2
            self.frames = [frame for frame in self.frames if frame[0] % self._stride == 0]
