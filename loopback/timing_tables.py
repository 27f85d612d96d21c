"""What `risorius bench --timings` prints: where the time of both ends goes."""

from collections.abc import Mapping, Sequence
from typing import Any

from loopback.report import Cell, table

ENDS = ("encoder", "decoder")
FRAME_TIMES = ("median", "p95", "worst")
# Figures of a live call by name, with their headings.
OF_THE_ENCODER = {
    "overloaded_frames": "in haste",
    "omitted_frames": "not looked at",
    "worst_lag_ms": "lag ms",
    "skipped_frames": "left out",
    "encoder_cpu_s": "CPU s",
}


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
    stages = table((clip["source"], "ms a frame", "CPU ms", "share %", "frames/s"), rows)
    return f"{stages}\n\n{frames_table(clip)}"


def frames_table(clip: Mapping[str, Any]) -> str:
    """How long single frames take at each end, ms, and how many went without what.

    Those of an encoder are of a live call, once it has begun, with the number of those in which
    something was left out in haste, of those among them that were not looked at, the largest lag,
    the number of frames that the source left out, and the CPU seconds of all its processes.  Those
    of a decoder are all after the first picture.
    """
    header = (clip["source"], "median ms", "95 % ms", "worst ms", *OF_THE_ENCODER.values())
    times = [[clip[f"{end}_frame_ms"].get(name) for name in FRAME_TIMES] for end in ENDS]
    missed: list[list[Cell]] = [[clip[n] for n in OF_THE_ENCODER], [None] * len(OF_THE_ENCODER)]
    return table(
        header, [[f"{e}, one frame", *t, *m] for e, t, m in zip(ENDS, times, missed, strict=True)]
    )


def _rows(clip: Mapping[str, Any], end: str) -> list[list[Cell]]:
    stages: Mapping[str, float] = clip[f"{end}_ms"]
    cpu_ms: Mapping[str, float] = clip[f"{end}_cpu_ms"]
    whole = sum(stages.values())

    def row(name: str, ms: float, cpu: float, fps: float | None) -> list[Cell]:
        share = 100 * ms / whole if whole else None
        return [f"{end}, {name}", float(ms), float(cpu), share, fps]

    rows = [row(name, ms, cpu_ms[name], None) for name, ms in stages.items()]
    return [*rows, row("whole", whole, sum(cpu_ms.values()), clip[f"{end}_fps"])]
