"""Leaves pictures out where a host cannot draw them all: a call must not come ever later."""

from collections.abc import Callable

# A packet's pictures come all at once, and are shown one after the other: each may be drawn so long
# after its turn.  One is left out then, and the next one that is in time is drawn.
ALLOWED_S = 0.06
# After so many one is drawn however late it is.
MAX_SKIPPED = 16


class Thinning:
    """Decides which pictures of a call are drawn.

    fps: pictures a second that are wanted, about; None: all.
    clock: of the times of arrival.
    arrival_s: when the packet came whose pictures are drawn now.
    """

    def __init__(self, fps: float | None, clock: Callable[[], float]) -> None:
        self._fps, self._clock = fps, clock
        self._first, self._skipped = 0, 0
        self._arrival_s: float | None = None  # of the packet that begins with the first picture
        self.arrival_s: float | None = None

    def wants(self, index: int, source_fps: float) -> bool:
        """Whether to draw the picture of source frame `index`.  source_fps: of the call."""
        step = frame_step(source_fps, self._fps)
        if self.arrival_s != self._arrival_s:
            self._arrival_s, self._first = self.arrival_s, index
        if index % step:
            return False
        if self._arrival_s is not None and self._skipped < MAX_SKIPPED:
            turn_s = self._arrival_s + (index - self._first) / source_fps
            if self._clock() > turn_s + ALLOWED_S:
                self._skipped += 1
                return False
        self._skipped = 0
        return True


def frame_step(source_fps: float, fps: float | None) -> int:
    """Of how many source frames one is wanted.  fps: about so many a second; None: all."""
    return 1 if fps is None else max(1, round(source_fps / fps))
