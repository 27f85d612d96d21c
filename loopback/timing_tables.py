"""What `risorius bench --timings` prints: where the time of both ends goes."""

from collections.abc import Mapping, Sequence
from typing import Any

from loopback.report import Cell, table

ENDS = ("encoder", "decoder")


def timings_tables(clips: Sequence[Mapping[str, Any]]) -> str:
    """One table for each clip of a bench's report, parted by blank lines."""
    return "\n\n".join(timings_table(clip) for clip in clips)


def timings_table(clip: Mapping[str, Any]) -> str:
    """Each end's stages: ms per source frame, CPU ms, share of the whole, % (None: no time at all).

    CPU time is that of the thread that waits for a stage: less than the time where other threads do
    the work, or where the machine does other things.  Stages that run once a call, as the model's,
    are spread over its frames.  Frames a second are those of an end that never waits, as its own
    process measured itself.
    """
    rows = [row for end in ENDS for row in _rows(clip, end)]
    return table((clip["source"], "ms a frame", "CPU ms", "share %", "frames/s"), rows)


def _rows(clip: Mapping[str, Any], end: str) -> list[list[Cell]]:
    stages: Mapping[str, float] = clip[f"{end}_ms"]
    cpu_ms: Mapping[str, float] = clip[f"{end}_cpu_ms"]
    whole = sum(stages.values())

    def row(name: str, ms: float, cpu: float, fps: float | None) -> list[Cell]:
        share = 100 * ms / whole if whole else None
        return [f"{end}, {name}", float(ms), float(cpu), share, fps]

    rows = [row(name, ms, cpu_ms[name], None) for name, ms in stages.items()]
    return [*rows, row("whole", whole, sum(cpu_ms.values()), clip[f"{end}_fps"])]
