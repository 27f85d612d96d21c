"""Source frames of a live call that wait: for their delay, or for the frame after them.

A frame whose landmarks are not looked for is fitted once its neighbours are.  Networks and landmark
fit take half of a frame's time.  Between two frames a face hardly leaves the way from one to the
other: it begins there, and is fitted to its own pixels.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from shared_model.arrays import Array, Picture


@dataclass(frozen=True, slots=True, eq=False)
class SeenFrame:
    """A source frame that has been seen and is not coded yet.

    picture: (h, w, 3) BGR, empty where the camera is off.
    points: (468, 3) landmarks, pixels; None: no face was found.
    seen_s: when, by the call's clock.
    is_other: from this frame on it is the face of somebody else.
    is_between: its landmarks are not looked for.
    """

    index: int
    picture: Picture
    points: Array | None
    seen_s: float
    is_other: bool = False
    is_between: bool = False


class FrameDelay:
    """Holds frames back for some time after they have been seen.

    delay_s: in the source's time.  fps: of the source.
    """

    def __init__(self, delay_s: float, fps: float) -> None:
        self._delay_s, self._frames = delay_s, round(delay_s * fps)
        self._seen = deque[SeenFrame]()

    def __bool__(self) -> bool:
        """Whether any frame has to wait."""
        return self._frames > 0

    @property
    def shows_face(self) -> bool:
        """Whether there is a face in a frame that waits."""
        return any(frame.points is not None for frame in self._seen)

    def add(self, frame: SeenFrame) -> None:
        """Add the newest frame."""
        self._seen.append(frame)

    def due(self, newest: int) -> Iterator[SeenFrame]:
        """The frames that have waited long enough when source frame `newest` has been seen."""
        while self._seen and self._seen[0].index <= newest - self._frames:
            yield self._seen.popleft()

    def rest(self, clock: Callable[[], float] | None) -> Iterator[SeenFrame]:
        """The frames that still wait.

        clock: that of `seen_s`, by which each waits its time; None: none waits any longer.
        """
        while self._seen:
            frame = self._seen.popleft()
            if clock is not None:
                time.sleep(max(0.0, frame.seen_s + self._delay_s - clock()))
            yield frame


def may_lack_landmarks(frames_to_last: int) -> bool:
    """Whether a frame may be coded without landmarks, `frames_to_last` before its packet's last.

    The last frame of a packet has landmarks.  A frame without lies between two of one packet, or
    follows the last of the packet before.
    """
    return frames_to_last % 2 == 1


@dataclass(frozen=True, slots=True, eq=False)
class Between:
    """A source frame between two whose landmarks are known.

    picture: (h, w, 3) BGR.  share: of the way from the one to the other, in time.
    points: (468, 3) landmarks in this share of the way, pixels.
    """

    index: int
    picture: Picture
    share: float
    points: Array


class FrameBetween:
    """Holds a frame until the one after it is fitted."""

    def __init__(self) -> None:
        self._waiting: tuple[int, Picture] | None = None
        self._before: tuple[int, Array] | None = None

    def wait(self, index: int, picture: Picture) -> None:
        """Hold source frame `index`."""
        self._waiting = index, picture

    def take(self, index: int, points: Array) -> Between | None:
        """The frame that waits, now that the landmarks (468, 3) of source frame `index` are known.

        None: none waits, or it did not come next after one whose landmarks are known.
        """
        waiting, before = self._waiting, self._before
        self._waiting, self._before = None, (index, points)
        if waiting is None or before is None or not before[0] < waiting[0] < index:
            return None
        share = (waiting[0] - before[0]) / (index - before[0])
        return Between(*waiting, share, before[1] + share * (points - before[1]))

    def take_last(self) -> Between | None:
        """The frame that waits at the end of a call, with the landmarks of the frame before it."""
        if self._waiting is None or self._before is None or self._waiting[0] < self._before[0]:
            return None
        return Between(*self._waiting, 0.0, self._before[1])
