"""Time stamps of a file's frames: read ahead of the frames, put in order, their jumps closed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from statistics import median
from typing import Any

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

# A step forward by more is a jump, as in FFmpeg (dts_delta_threshold); backward by more than
# frames are reordered by.
MAX_GAP_S, MAX_REORDERING_S, MAX_REORDERING_FRAMES = Fraction(10), Fraction(1), 20
# A file whose sound and pictures all end earlier than it says, by more than this, is cut off.
CUT_OFF_S = Fraction(1, 2)


@dataclass(frozen=True, slots=True)
class TimeStamps:
    """When the frames of a file are shown.

    times_s: seconds, ascending, all different; empty: not known.
    jumps: how often the stamps jumped, by hours or back to the start.
    missing: frames that the container states and does not have.
    """

    times_s: tuple[Fraction, ...] = ()
    jumps: int = 0
    missing: int = 0

    def starting_at(self, first_s: Fraction) -> "TimeStamps":
        """Those from `first_s` on; the frames before cannot be read and count as missing."""
        before = sum(time_s < first_s for time_s in self.times_s)
        missing = self.missing + before
        return replace(self, times_s=self.times_s[before:], missing=missing)


def ordered_time_stamps(stamps_s: Sequence[Fraction], missing: int = 0) -> TimeStamps:
    """From the stamps of frames in coding order, seconds."""
    steps_s = [abs(b - a) for a, b in pairwise(stamps_s) if a != b]
    if not steps_s:
        # At most one frame, or one time for all: nothing is known.
        return TimeStamps(missing=missing)
    period_s = median(steps_s)
    runs = _runs(stamps_s, period_s)
    times_s: list[Fraction] = []
    for run in runs:
        ordered = _different(sorted(run), period_s)
        begin_s = times_s[-1] + period_s if times_s else ordered[0]
        times_s += [time_s - ordered[0] + begin_s for time_s in ordered]
    return TimeStamps(tuple(times_s), len(runs) - 1, missing)


def _runs(stamps_s: Sequence[Fraction], period_s: Fraction) -> list[list[Fraction]]:
    """The stamps, divided where they jump."""
    forward_s = max(MAX_GAP_S, MAX_REORDERING_FRAMES * period_s)
    backward_s = max(MAX_REORDERING_S, MAX_REORDERING_FRAMES * period_s)
    runs, newest_s = [[stamps_s[0]]], stamps_s[0]
    for stamp_s in stamps_s[1:]:
        if newest_s - backward_s <= stamp_s <= newest_s + forward_s:
            runs[-1].append(stamp_s)
            newest_s = max(newest_s, stamp_s)
        else:
            runs.append([stamp_s])
            newest_s = stamp_s
    return runs


def _different(times_s: list[Fraction], period_s: Fraction) -> list[Fraction]:
    """Ascending times, none twice: frames of one time are spread until the time that follows."""
    spread: list[Fraction] = []
    first = 0
    while first < len(times_s):
        end = first
        while end < len(times_s) and times_s[end] == times_s[first]:
            end += 1
        until_s = times_s[end] if end < len(times_s) else times_s[first] + (end - first) * period_s
        step_s = (until_s - times_s[first]) / (end - first)
        spread += [times_s[first] + i * step_s for i in range(end - first)]
        first = end
    return spread


def read_time_stamps(container: InputContainer, stream: VideoStream) -> TimeStamps:
    """The time stamps of a stream of a newly opened container, which is read to its end."""
    stamps_s: list[Fraction | None] = []
    stated, end_s, other_end_s = 0, Fraction(0), Fraction(0)
    try:
        for packet in container.demux():
            if packet.stream is not stream:
                other_end_s = max(other_end_s, _end_s(packet))
            elif packet.size:
                stated += 1
                end_s = max(end_s, _end_s(packet))
                if not packet.is_discard:
                    stamps_s.append(_seconds(packet, packet.pts))
    except av.FFmpegError:
        pass  # The file is damaged here: so are the pictures.
    missing = max(0, stream.frames - stated) if _counts_frames(container) else 0
    if not missing:
        missing = _cut_off(container, stream, end_s, max(end_s, other_end_s))
    known_s = [stamp_s for stamp_s in stamps_s if stamp_s is not None]
    # Those of some frames only say nothing about the others.
    return ordered_time_stamps(known_s if len(known_s) == len(stamps_s) else [], missing)


def _counts_frames(container: InputContainer) -> bool:
    """Whether the container's number of frames is that of its packets."""
    return "mp4" in container.format.name


def _cut_off(
    container: InputContainer, stream: VideoStream, end_s: Fraction, last_s: Fraction
) -> int:
    """Frames between the end of the pictures and that of the whole file, if it is cut off."""
    start_s = Fraction(container.start_time or 0, av.time_base)
    stated_s = start_s + Fraction(container.duration or 0, av.time_base)
    if stated_s - last_s < CUT_OFF_S:
        return 0
    return round((stated_s - end_s) * Fraction(stream.guessed_rate or 0))


def _seconds(packet: "Packet[Any]", stamp: int | None) -> Fraction | None:
    return None if stamp is None or packet.time_base is None else stamp * packet.time_base


def _end_s(packet: "Packet[Any]") -> Fraction:
    start_s = _seconds(packet, packet.pts if packet.pts is not None else packet.dts)
    length_s = _seconds(packet, packet.duration)
    return (start_s or Fraction(0)) + (length_s or Fraction(0))
