"""Uniform subsampling of the frames of a source of unknown length."""

from collections.abc import Callable
from typing import Generic, TypeVar

Kept = TypeVar("Kept")

# The fewest frames of a longer source that a person model is built from.
TRAINING_FRAMES = 64
# Of a source with more frames no two in a row are: they show nearly the same, and cost as much.
DENSE_FRAMES = 64


class UniformSubsampler(Generic[Kept]):
    """Keeps every 2^k-th frame of a source, `min_frames` to twice as many once there are so many.

    dense_frames: a source of so many frames or more is not kept whole; None: of twice `min_frames`.
    frames: index and what is kept of each frame so far.
    """

    def __init__(self, min_frames: int = TRAINING_FRAMES, dense_frames: int | None = None) -> None:
        self._most, self._stride = 2 * min_frames, 1
        self._dense = dense_frames or self._most
        self.frames: list[tuple[int, Kept]] = []

    def offer(self, index: int, make: Callable[[], Kept]) -> None:
        """Offer frame `index`, counted from 0 without a gap.

        make: returns what to keep of the frame; called only if the frame is kept.
        """
        if index % self._stride:
            return
        self.frames.append((index, make()))
        if len(self.frames) >= (self._dense if self._stride == 1 else self._most):
            self._stride *= 2
            self.frames = [frame for frame in self.frames if frame[0] % self._stride == 0]
