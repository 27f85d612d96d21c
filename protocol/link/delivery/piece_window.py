"""How many pieces may be on their way to one decoder, and what its link carries.

A window that grows with what is acknowledged while nothing waits in the link, and shrinks while
something does.  Losses do not shrink it: a lossy link is no slower for that.
"""

from dataclasses import dataclass
from statistics import median_high

from protocol.link.messages import PIECE_BYTES

START_WINDOW, MIN_WINDOW, MAX_WINDOW = 4.0, 2.0, 96.0
# Bytes of IP, UDP and Zenoh around a piece.
PIECE_OVERHEAD_BYTES = 45
WHOLE_PIECE_BYTES = PIECE_BYTES + PIECE_OVERHEAD_BYTES
# The window once the rate has been measured, at most: what a fast link holds, a whole model.
MAX_FIRST_WINDOW = 24.0
# Before anything is known of the link.
DEFAULT_ROUND_TRIP_S = 0.5
# What a piece may take longer than the shortest round trip before the link counts as filled.
FILLED_S = 0.15
# A piece counts as lost if one that was sent so much later has arrived.
REORDERING_S = 0.06
MIN_TIMEOUT_S, MAX_TIMEOUT_S = 0.25, 8.0
# Less is no difference that could be measured.
MIN_LATER_S = 0.004
# One measurement of a rate above this is enough, else so many.
SURE_BPS, SURE_TRIPS = 64_000.0, 3
# How long the highest rate that was measured holds.
RATE_MEMORY_S = 10.0


@dataclass(frozen=True, slots=True)
class Sent:
    """When a piece was sent last, and how many bytes had been acknowledged by then.

    flying: bytes that were on their way then, with it.
    """

    time_s: float
    delivered: int
    flying: int = 0
    again: bool = False


class PieceWindow:
    """The window of one decoder.

    rate_bps: of the link, if it is known.
    round_trip_s, rate_bps: None before they are measured.
    """

    def __init__(self, rate_bps: float | None = None) -> None:
        self.round_trip_s: float | None = None
        self.rate_bps, self._is_told = rate_bps, rate_bps is not None
        self._first_rates = list[float]()
        self.delivered = 0
        self._size = START_WINDOW
        self._newest_s = float("-inf")  # when the newest piece that arrived was sent
        self._rate_s = float("-inf")

    @property
    def padded_trips(self) -> int:
        """How often a padded message has measured the rate."""
        return len(self._first_rates)

    @property
    def is_measured(self) -> bool:
        """Whether the rate is known: a low one that was measured might have been an accident."""
        return self._is_told or self.padded_trips >= SURE_TRIPS or (self.rate_bps or 0.0) > SURE_BPS

    @property
    def size(self) -> int:
        """Pieces that may be on their way."""
        return int(self._size)

    def on_round_trip(self, seconds: float) -> None:
        """A short message and its answer have taken so long."""
        known = self.round_trip_s
        self.round_trip_s = seconds if known is None else min(seconds, 0.9 * known + 0.1 * seconds)

    def on_padding(self, later_s: float, padding_bytes: int) -> None:
        """A message with so many bytes more has been answered later than the one before it."""
        self._first_rates.append(8 * padding_bytes / max(later_s, MIN_LATER_S))
        if self._rate_s == float("-inf"):
            self.rate_bps = median_high(self._first_rates)
            filling = self.rate_bps * (self.round_trip_s or 0.0) / (8 * WHOLE_PIECE_BYTES)
            self._size = max(self._size, min(filling, MAX_FIRST_WINDOW))

    def on_piece(self, sent: Sent, size: int, now_s: float) -> None:
        """A piece of `size` bytes has been acknowledged."""
        self.delivered += size + PIECE_OVERHEAD_BYTES
        self._newest_s = max(self._newest_s, sent.time_s)
        if sent.again:
            return
        took_s = max(now_s - sent.time_s, 1e-3)
        self._take_rate(8 * (self.delivered - sent.delivered) / took_s, now_s)
        known = self.round_trip_s
        if known is None or took_s < known:
            self.round_trip_s = known = took_s
        if took_s < known + FILLED_S:
            self._size = min(self._size + 1, MAX_WINDOW)
        elif took_s > known + 2 * FILLED_S:
            self._size = max(self._size - 0.5, MIN_WINDOW)

    def is_lost(self, sent: Sent, now_s: float, flying: int) -> bool:
        """Whether a piece that has not been acknowledged has to be sent again.

        flying: bytes on their way.
        """
        flying = max(flying, sent.flying)
        if sent.time_s + REORDERING_S < self._newest_s:
            return True
        return now_s - sent.time_s > self.timeout_s(flying)

    def timeout_s(self, flying: int) -> float:
        """After what time a piece counts as lost."""
        round_trip_s = DEFAULT_ROUND_TRIP_S if self.round_trip_s is None else self.round_trip_s
        queue_s = 8 * flying / self.rate_bps if self.rate_bps else 0.0
        return min(max(1.5 * (round_trip_s + queue_s) + 0.1, MIN_TIMEOUT_S), MAX_TIMEOUT_S)

    def _take_rate(self, rate_bps: float, now_s: float) -> None:
        """The highest rate of late; what the padding told is a first guess."""
        is_old = now_s - self._rate_s > RATE_MEMORY_S
        if self.rate_bps is None or is_old or rate_bps > self.rate_bps:
            self.rate_bps, self._rate_s = rate_bps, now_s
