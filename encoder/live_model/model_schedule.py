"""When a live call's model is trained again, from which frames, and how its reserved modes are
spread over time.
"""

import math
from collections.abc import Mapping

from encoder.learning.frame_sampler import UniformSubsampler
from encoder.live_model.model_version import RESERVED_MODES
from shared_model.arrays import Array, Picture

# The number of reserved modes used by time t is proportional to (t / T) ** this, T being the time
# from one update to the next: a quarter of the time takes half of them.  On all 200 s of franck, .5
# dB more than when each mode is learned as soon as possible, which leaves none for the second half
# of a minute and more; an exponent of .35 gave .4 dB.
MODE_SPENDING_EXPONENT = 0.5


class ModelSchedule:
    """When updates are due, counted in source frames with a face.

    fps: frames per second of the source.
    updates: seconds of the person's face after which the model is trained again, and the share of
        the budget for texture and modes that the update takes.  Later ones follow each time that
        what has been seen has doubled.
    """

    def __init__(self, fps: float, updates: Mapping[float, float]) -> None:
        self._fps = fps
        self._due = list(updates.items())
        self._last_s = 0.0  # when the newest update was due

    def is_update_due(self, faces: int) -> bool:
        """Whether to train an update after so many frames with a face."""
        return faces >= self._due[0][0] * self._fps

    def first_share(self, faces: int) -> float | None:
        """The share of the budget for the first version, which takes the place of an update that is
        due after so many frames with a face; None: none is.
        """
        return self.take_update() if self.is_update_due(faces) else None

    def take_update(self) -> float:
        """Start the update that is due: the share of the budget that it takes."""
        self._last_s, share = self._due.pop(0)
        if not self._due:
            self._due.append((2 * self._last_s, share))
        return share

    def modes_to_reserve(self, faces: int) -> int:
        """How many reserved modes to leave for the frames from now until the next update."""
        period_s = self._due[0][0] - self._last_s
        passed = (faces / self._fps - self._last_s) / period_s
        used = math.pow(min(max(passed, 0.0), 1.0), MODE_SPENDING_EXPONENT)
        return round(RESERVED_MODES * (1 - used))


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
