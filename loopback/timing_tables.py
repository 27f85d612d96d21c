"""What `risorius bench --timings` prints: where the time of both ends goes."""

from collections.abc import Mapping, Sequence
from typing import Any

from loopback.report import Cell, table

ENDS = ("encoder", "decoder")


def timings_tables(clips: Sequence[Mapping[str, Any]]) -> str:
    """One table for each clip of a bench's report, parted by blank lines."""
    return "\n\n".join(timings_table(clip) for clip in clips)


def timings_table(clip: Mapping[str, Any]) -> str:
    """Each end's stages: ms per source frame, share of that end's whole, % (None: no time at all).

    Stages that run once a call, as the model's, are spread over its frames.  Frames a second are
    those of an end that never waits, as its own process measured itself.
    """
    rows = [row for end in ENDS for row in _rows(clip, end)]
    return table((clip["source"], "ms a frame", "share %", "frames/s"), rows)


def _rows(clip: Mapping[str, Any], end: str) -> list[list[Cell]]:
    stages: Mapping[str, float] = clip[f"{end}_ms"]
    whole = sum(stages.values())

    def row(name: str, ms: float, fps: float | None) -> list[Cell]:
        return [f"{end}, {name}", float(ms), 100 * ms / whole if whole else None, fps]

    rows = [row(name, ms, None) for name, ms in stages.items()]
    return [*rows, row("whole", whole, clip[f"{end}_fps"])]
