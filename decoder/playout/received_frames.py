"""The faces of a call as its packets come in, and what is counted on the way."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum

from decoder.playout.call_playout import CallPlayout
from decoder.playout.playout import PlayoutFrame
from protocol.call_records import TruncatedCall
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival, PacketSource
from protocol.packets import PacketKind, packet_kind

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

    frame_bytes: payload of frame packets, with the voice in them.
    pictures: number of pictures shown.
    frozen_frames: pictures that repeat an older face because the encoder had none.
    lost_frames: pictures in place of those whose packets are lost.
    damaged: number of packets that are damaged; damages: what was wrong with the first of them.
    shown_ns: for each picture its source frame and `time.monotonic_ns` when it was complete; empty
        unless `keeps_times`.
    frame_ms: how long each picture after the first has taken, but for writing it; empty likewise.
    arrival_s: `time.monotonic` when the newest packet came.
    """

    model_bytes: int = 0
    frame_bytes: int = 0
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
        self, error: ProtocolError, playout: CallPlayout, frame: int | None = None
    ) -> None:
        """Add a damaged packet with the first frame that it can affect; None: the next one."""
        self.damaged += 1
        if self.damaged > MAX_DAMAGES_TOLD:
            return
        model = playout.model
        frame = max(playout.next_frame, 0) if frame is None else frame
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

    def note_received(self, data: bytes) -> None:
        """Count the bytes of a packet."""
        with suppress(ProtocolError):
            kind = packet_kind(data)
            if kind in (PacketKind.MODEL, PacketKind.LAYER):
                self.model_bytes += len(data) - 1
            elif kind is PacketKind.FRAME:
                self.frame_bytes += len(data) - 1


def received_frames(
    source: PacketSource,
    playout: CallPlayout,
    stats: DecodeStats,
    stop: Callable[[], bool],
    waiting: Callable[[], Waiting] = lambda: Waiting.NONE,
) -> Iterator[PlayoutFrame | None]:
    """The faces of the call's source frames; None before each wait for a packet.

    waiting: where frames wait to be drawn packets are not waited for.
    Damaged packets are counted and skipped.
    """
    for arrival in _arrivals(source, playout, stats, stop, waiting):
        if arrival is None:
            frames = playout.poll(time.monotonic())
        else:
            stats.note_received(arrival.data)
            stats.arrival_s = arrival.time_s
            frames = playout.receive(arrival)
        yield from _undamaged(frames, playout, stats, stop)
        if playout.ended:
            return
        yield None
    # Nothing more can come: what waits need not wait any longer.
    while not stop() and playout.release_s is not None:
        yield from _undamaged(playout.poll(playout.release_s), playout, stats, stop)


def _undamaged(
    frames: Iterator[PlayoutFrame],
    playout: CallPlayout,
    stats: DecodeStats,
    stop: Callable[[], bool],
) -> Iterator[PlayoutFrame]:
    while not stop():
        try:
            frame = next(frames, None)
        except ProtocolError as error:
            stats.note_damage(error, playout)
            return
        if frame is None:
            return
        yield frame


def _arrivals(
    source: PacketSource,
    playout: CallPlayout,
    stats: DecodeStats,
    stop: Callable[[], bool],
    waiting: Callable[[], Waiting],
) -> Iterator[Arrival | None]:
    """What comes; None when nothing has for a while or a packet is no longer waited for."""
    while not stop() and not source.ended:
        while waiting() is Waiting.MANY and not stop():
            yield None
        release_s, wait_s = playout.release_s, POLL_S
        if release_s is not None:
            wait_s = min(max(release_s - time.monotonic(), 0.0), POLL_S)
        if waiting() is Waiting.SOME:
            wait_s = 0.0
        try:
            arrival = source.receive(wait_s)
        except TruncatedCall as error:
            stats.warnings.append(str(error))
            return
        except ProtocolError as error:
            stats.note_damage(error, playout)
            continue
        if arrival is not None or not source.ended:
            yield arrival
