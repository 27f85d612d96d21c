"""Leaves pictures out where a host cannot draw them all: a call must not come ever later."""

from collections.abc import Callable

# How much later than the quickest a picture may be drawn, beside the time of a packet, whose
# pictures come all at once; with each `STEP_S` more fewer pictures are drawn.
ALLOWED_S, STEP_S, MAX_STEP = 0.1, 0.08, 8
# The quickest is forgotten by so many seconds in each second.
FORGET = 0.005
# A call that jumps by so much has begun anew.
JUMP_S = 5.0


class Thinning:
    """Decides which pictures of a call are drawn.

    fps: pictures a second that are wanted, about; None: all.
    clock: seconds from any origin.
    """

    def __init__(self, fps: float | None, clock: Callable[[], float]) -> None:
        self._fps, self._clock = fps, clock
        self._quickest_s: float | None = None
        self._lag_s = self._noted_s = 0.0

    def wants(self, index: int, source_fps: float, packet_s: float) -> bool:
        """Whether to draw the picture of source frame `index`.

        source_fps: of the call.  packet_s: time that a packet covers.
        """
        now_s = self._clock()
        self._note(now_s, index / source_fps)
        step = 1 if self._fps is None else max(1, round(source_fps / self._fps))
        behind_s = self._lag_s - packet_s - ALLOWED_S
        if behind_s > 0:
            step = max(step, min(MAX_STEP, 2 + int(behind_s / STEP_S)))
        return index % step == 0

    def _note(self, now_s: float, time_s: float) -> None:
        late_s = now_s - time_s
        if self._quickest_s is None or abs(late_s - self._quickest_s) > JUMP_S:
            self._quickest_s = late_s
        forgotten_s = FORGET * (now_s - self._noted_s)
        self._quickest_s = min(self._quickest_s + forgotten_s, late_s)
        self._noted_s, self._lag_s = now_s, late_s - self._quickest_s
