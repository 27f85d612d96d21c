"""Leaves pictures out where a host cannot draw them all: a call must not come ever later."""

from collections.abc import Callable

# How long after its packet has come a picture may be drawn, beside the time of that packet, whose
# pictures come all at once; with each `STEP_S` more fewer pictures are drawn.
ALLOWED_S, STEP_S, MAX_STEP = 0.1, 0.08, 16


class Thinning:
    """Decides which pictures of a call are drawn.

    fps: pictures a second that are wanted, about; None: all.
    clock: of the times of arrival.
    arrival_s: when the packet came whose pictures are drawn now.
    """

    def __init__(self, fps: float | None, clock: Callable[[], float]) -> None:
        self._fps, self._clock = fps, clock
        self.arrival_s: float | None = None

    def wants(self, index: int, source_fps: float, packet_s: float) -> bool:
        """Whether to draw the picture of source frame `index`.

        source_fps: of the call.  packet_s: time that a packet covers.
        """
        step = 1 if self._fps is None else max(1, round(source_fps / self._fps))
        if self.arrival_s is not None:
            behind_s = self._clock() - self.arrival_s - packet_s - ALLOWED_S
            if behind_s > 0:
                step = max(step, min(MAX_STEP, 2 + int(behind_s / STEP_S)))
        return index % step == 0
