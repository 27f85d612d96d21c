"""The frames that a live call's model is trained from."""

from encoder.learning.frame_sampler import UniformSubsampler
from shared_model.arrays import Array, Picture


class TrainingFrames:
    """A uniform subsample of the frames with a face, and their landmarks.

    least: number of frames to train from; there are up to twice as many.
    """

    def __init__(self, least: int) -> None:
        self._least = least
        self.forget()

    def forget(self) -> None:
        """Begin again: the next frames are of somebody else."""
        self._sampler = UniformSubsampler[tuple[Picture, Array]](self._least)
        self._count = 0

    def offer(self, picture: Picture, points: Array) -> None:
        """Take or leave a frame with its landmarks (468, 3), pixels."""
        self._sampler.offer(self._count, lambda: (picture.copy(), points))
        self._count += 1

    def sample(self) -> tuple[list[Picture], list[Array]]:
        """The frames to train from, and the landmarks of each."""
        kept = [each for _, each in self._sampler.frames]
        return [picture for picture, _ in kept], [points for _, points in kept]
