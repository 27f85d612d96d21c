"""The faces of a call as its packets come in, and what is counted on the way."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum

from decoder.playout.playout import PlayoutFrame
from decoder.playout.receiver import Receiver
from protocol.call_records import TruncatedCall
from protocol.errors import ProtocolError
from protocol.link.interface import PacketSource

# Interval at which a decoder that waits for packets calls `stop`.
POLL_S = 0.1
# Damaged packets that are reported one by one.
MAX_DAMAGES_TOLD = 5


class Waiting(Enum):
    """How many frames wait to be drawn: NONE, SOME or so MANY that no packet is taken meanwhile."""

    NONE = 0
    SOME = 1
    MANY = 2


@dataclass(slots=True)
class DecodeStats:
    """Counts, times and warnings of one call on the receiving side.

    pictures: number of pictures shown.
    frozen_frames: pictures that repeat an older face because the encoder had none.
    lost_frames: pictures in place of those whose packets are lost.
    damaged: number of packets that are damaged; damages: what was wrong with the first of them.
    shown_ns: for each picture its source frame and `time.monotonic_ns` when it was complete; empty
        unless `keeps_times`.
    frame_ms: how long each picture after the first has taken, but for writing it; empty likewise.
    arrival_s: `time.monotonic` when the newest packet came.
    """

    pictures: int = 0
    frozen_frames: int = 0
    lost_frames: int = 0
    damaged: int = 0
    damages: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    keeps_times: bool = False
    shown_ns: list[tuple[int, int]] = field(default_factory=list)
    frame_ms: list[float] = field(default_factory=list)
    arrival_s: float = 0.0

    def note_damage(
        self, error: ProtocolError, receiver: Receiver, frame: int | None = None
    ) -> None:
        """Add a damaged packet.  frame: the first that it can affect; None: the next to show."""
        self.damaged += 1
        if self.damaged > MAX_DAMAGES_TOLD:
            return
        model = receiver.model
        frame = max(receiver.next_frame, 0) if frame is None else frame
        where = f", at frame {frame} ({frame / model.call.fps:.2f} s)" if model else ""
        self.damages.append(f"{error}{where}")

    def note_shown(self, frame: PlayoutFrame) -> None:
        """Count a picture that is complete now."""
        self.pictures += 1
        if self.keeps_times:
            self.shown_ns.append((frame.index, time.monotonic_ns()))
        self.lost_frames += frame.lost
        self.frozen_frames += frame.frozen and not frame.lost

    def note_drawn(self, ms: float) -> None:
        """Keep how long a picture has taken."""
        if self.keeps_times:
            self.frame_ms.append(ms)


def received_frames(
    source: PacketSource,
    receiver: Receiver,
    stats: DecodeStats,
    stop: Callable[[], bool],
    waiting: Callable[[], Waiting] = lambda: Waiting.NONE,
) -> Iterator[list[PlayoutFrame]]:
    """The faces of the call's source frames, after each packet and each wait for one.

    waiting: where frames wait to be drawn packets are not waited for.
    Damaged packets are counted and skipped.
    """
    while not stop() and not source.ended and not receiver.ended:
        if waiting() is Waiting.MANY:
            yield receiver.poll(time.monotonic())
            continue
        try:
            arrival = source.receive(_wait_s(receiver, waiting()))
        except TruncatedCall as error:
            stats.warnings.append(str(error))
            break
        except ProtocolError as error:
            stats.note_damage(error, receiver)
            continue
        if arrival is not None:
            stats.arrival_s = arrival.time_s
            yield receiver.receive(arrival)
        elif not source.ended:
            yield receiver.poll(time.monotonic())
    # Nothing more can come: what waits need not wait any longer.
    while not stop() and not receiver.ended and receiver.release_s is not None:
        yield receiver.poll(receiver.release_s)


def _wait_s(receiver: Receiver, waiting: Waiting) -> float:
    """How long to wait for a packet: until another one is no longer waited for, at most."""
    if waiting is Waiting.SOME:
        return 0.0
    if receiver.release_s is None:
        return POLL_S
    return min(max(receiver.release_s - time.monotonic(), 0.0), POLL_S)
