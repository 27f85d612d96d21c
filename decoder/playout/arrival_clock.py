"""Expected arrival times of packets, from the arrivals of earlier ones."""

from collections import deque
from statistics import median

import numpy as np

# Packets that are remembered: ten seconds at three packets a second.
REMEMBERED = 32
# How long a missing packet is waited for, at least and at most, after the time it is expected.
MIN_WAIT_S, MAX_WAIT_S = 0.4, 1.0


class ArrivalClock:
    """Relates the time of arrival to a packet's time in the call, that of its newest face.

    max_wait_s: limit of `wait_s`.
    """

    def __init__(self, max_wait_s: float = MAX_WAIT_S) -> None:
        self._max_wait_s = max_wait_s
        self._offsets: deque[float] = deque(maxlen=REMEMBERED)
        self._overtaken: deque[float] = deque(maxlen=REMEMBERED)

    def note(self, call_s: float, arrival_s: float, is_overtaken: bool) -> None:
        """Note an arrival.

        call_s: the packet's time in the call, seconds; arrival_s: of the receiver's clock.
        is_overtaken: a later packet came before it, so it was probably sent again.
        """
        self._offsets.append(arrival_s - call_s)
        if is_overtaken:
            self._overtaken.append(arrival_s - call_s)

    @property
    def start_s(self) -> float | None:
        """When the call's time 0 would have arrived; None before the first arrival."""
        return min(self._offsets) if self._offsets else None

    @property
    def wait_s(self) -> float:
        """How long to wait for a packet after it is expected.

        As long as 95 of 100 packets take, and what a repetition takes besides; the longest, while
        none has been repeated.
        """
        if not self._overtaken:
            return self._max_wait_s
        start_s = min(self._offsets)
        late_s = float(np.percentile(self._offsets, 95)) - start_s
        repeat_s = median(self._overtaken) - start_s
        return min(max(late_s + repeat_s, MIN_WAIT_S), self._max_wait_s)

    def expected_s(self, call_s: float) -> float:
        """When a packet of this time in the call arrives if nothing delays it."""
        assert self._offsets
        return min(self._offsets) + call_s
