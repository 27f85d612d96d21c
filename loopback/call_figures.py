"""The figures of a call that both ends' reports tell, apart from those of its pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import numpy as np

from encoder.capture.frame_times import exact_fps
from loopback.process_pair import CallResult
from loopback.report import rounded
from protocol.summary import nominal_duration_s

Report = Mapping[str, Any]


class Kind(Enum):
    """What a figure is: a number, numbers by name, or nothing that can be held against a limit."""

    NUMBER = auto()
    NUMBERS = auto()
    NOTE = auto()


@dataclass(frozen=True, slots=True)
class CallFigure:
    """How a figure is taken from the reports of encoder and decoder.

    parts: names of its numbers; empty: those of the stages or levels that there are.
    """

    take: Callable[[Report, Report], Any]
    kind: Kind = Kind.NUMBER
    parts: tuple[str, ...] = ()


def call_figures(result: CallResult, profile: str) -> dict[str, Any]:
    """What the two ends' reports say together."""
    ends = result.encoder | {"profile": profile}, result.decoder
    return {name: figure.take(*ends) for name, figure in CALL_FIGURES.items()}


def is_call_figure(name: str) -> bool:
    """Whether a call has a number of this dotted name."""
    head, dot, part = name.partition(".")
    figure = CALL_FIGURES.get(head)
    if figure is None or figure.kind is not (Kind.NUMBERS if dot else Kind.NUMBER):
        return False
    return not figure.parts or part in figure.parts


def latency_ms(
    capture_ns: Sequence[int], shown_ns: Sequence[Sequence[int]]
) -> dict[str, float | None]:
    """Milliseconds from the capture of a source frame to its picture: median and 99th percentile.

    capture_ns: by source frame; shown_ns: (source frame, time) pairs; both of one monotonic clock.
    """
    spans = [
        (time - capture_ns[frame]) / 1e6 for frame, time in shown_ns if frame < len(capture_ns)
    ]
    if not spans:
        return {"p50": None, "p99": None}
    p50, p99 = np.percentile(spans, [50, 99])
    return {"p50": rounded(float(p50)), "p99": rounded(float(p99))}


def _sent(name: str, digits: int | None = None) -> CallFigure:
    """As the encoder says it."""
    return CallFigure(lambda sent, _: sent[name] if digits is None else rounded(sent[name], digits))


def _shown(name: str) -> CallFigure:
    """As the decoder says it."""
    return CallFigure(lambda _, shown: shown[name])


def _times(end: int, name: str) -> CallFigure:
    """Milliseconds by name.  end: 0 of the encoder, 1 of the decoder."""

    def take(*ends: Report) -> dict[str, float | None]:
        return {stage: rounded(ms, 3) for stage, ms in ends[end][name].items()}

    return CallFigure(take, Kind.NUMBERS)


def _busy_fps(report: Report) -> float | None:
    """Frames a second that this end would reach if it never waited."""
    busy_ms = sum(report["stage_ms"].values())
    return rounded(1000 / busy_ms, 1) if busy_ms else None


def _frame_bps(sent: Report, shown: Report) -> float | None:
    seconds = nominal_duration_s(sent["profile"], sent["frames"], exact_fps(sent["fps"]))
    return rounded(8 * sent["frame_bytes"] / seconds, 1)


def _events(sent: Report, shown: Report) -> list[dict[str, Any]]:
    return [
        {"event": name, "time_s": rounded(frame / sent["fps"], 3)} for name, frame in sent["events"]
    ]


# In the order of report.json.
CALL_FIGURES = {
    "profile": CallFigure(lambda sent, _: sent["profile"], Kind.NOTE),
    "frames": _sent("frames"),
    "shown_frames": _shown("frames"),
    "fps": _sent("fps", 3),
    "width": _sent("width"),
    "height": _sent("height"),
    "duration_s": CallFigure(lambda sent, _: rounded(sent["frames"] / sent["fps"], 3)),
    "model_bytes": _sent("model_bytes"),
    "frame_bytes": _sent("frame_bytes"),
    "frame_bps": CallFigure(_frame_bps),
    "lost_packets": _shown("lost_packets"),
    "lost_frames": _sent("lost_frames"),
    "latency_ms": CallFigure(
        lambda sent, shown: latency_ms(sent["capture_ns"], shown["shown_ns"]),
        Kind.NUMBERS,
        ("p50", "p99"),
    ),
    "encoder_ms": _times(0, "stage_ms"),
    "decoder_ms": _times(1, "stage_ms"),
    "encoder_cpu_ms": _times(0, "stage_cpu_ms"),
    "decoder_cpu_ms": _times(1, "stage_cpu_ms"),
    "encoder_frame_ms": _times(0, "frame_ms"),
    "decoder_frame_ms": _times(1, "frame_ms"),
    "overloaded_frames": _sent("overloaded_frames"),
    "overload_levels": CallFigure(lambda sent, _: sent["overload_levels"], Kind.NUMBERS),
    "omitted_frames": _sent("omitted_frames"),
    "worst_lag_ms": _sent("worst_lag_ms", 1),
    "skipped_frames": _sent("skipped_frames"),
    "encoder_cpu_s": _sent("cpu_s", 1),
    "events": CallFigure(_events, Kind.NOTE),
    "encoder_fps": CallFigure(lambda sent, _: _busy_fps(sent)),
    "decoder_fps": CallFigure(lambda _, shown: _busy_fps(shown)),
    "warnings": CallFigure(lambda *ends: [each for e in ends for each in e["warnings"]], Kind.NOTE),
}
