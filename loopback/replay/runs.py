"""Measures the clips of a suite, and holds what it says against them."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from decoder.pipeline import DecodeOptions, decode
from encoder.capture.video_source import open_source
from loopback.bench import bench_clip, make_folder, output_names
from loopback.call_packets import call_packets
from loopback.judge.comparison import compare, observe_source
from loopback.judge.observer import Observer, find_observer
from loopback.replay.checks import EVENTS, PICTURES, Check, check_baseline, check_limits
from loopback.replay.suite import Clip, Suite, check_inputs
from loopback.report import rounded
from protocol.packets import ControlPacket
from protocol.summary import summarise
from shared_model.errors import UserError

Say = Callable[[str], None]
Baseline = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ClipResult:
    """What came of one clip; `error`: why it could not be measured."""

    name: str
    figures: Mapping[str, Any]
    checks: tuple[Check, ...]
    error: str | None

    @property
    def passed(self) -> bool:
        """It was measured and no rule was broken."""
        return self.error is None and all(check.passed for check in self.checks)


def replay(
    suite: Suite, folder: Path, say: Say, baseline: Baseline | None = None
) -> Iterator[ClipResult]:
    """Measure one clip of the suite after the other; decoded videos stay in `folder`.

    baseline: see `check_baseline`.
    Raises `UserError` as `check_inputs` does, before anything runs.
    """
    check_inputs(suite)
    names = output_names([clip.name for clip in suite.clips])
    observer = find_observer()
    make_folder(folder)
    for clip, name in zip(suite.clips, names, strict=True):
        say(f"replay: {clip.name}")
        before = (baseline or {}).get(clip.name, {})
        yield _replay_clip(clip, folder / f"{name}.mkv", observer, say, before)


def check(
    clip: Clip, figures: Mapping[str, Any], before: Mapping[str, Any] | None = None
) -> tuple[Check, ...]:
    """Hold all that a suite says against the figures of a report.

    before: those of the baseline.
    """
    limits = check_limits(figures, clip.least, clip.most)
    events = (event.check(figures.get("events", ())) for event in clip.events)
    return (*limits, *events, *check_baseline(figures, before or {}, clip.tolerances))


def _replay_clip(
    clip: Clip, output: Path, observer: Observer, say: Say, before: Mapping[str, Any]
) -> ClipResult:
    try:
        if clip.is_call:
            figures = replay_call(clip, output, observer, say)
        else:
            figures = bench_clip(clip.path, clip.settings, output, observer, say)
    except UserError as error:
        return ClipResult(clip.name, {"source": clip.name}, (), str(error))
    return ClipResult(clip.name, figures, check(clip, figures, before), None)


def replay_call(clip: Clip, output: Path, observer: Observer, say: Say) -> dict[str, Any]:
    """The figures of a recorded call that goes straight into a decoder."""
    call = Path(clip.path)
    decode(DecodeOptions(call_file=call, output=output), lambda done, total: None, lambda: False)
    summary, pictures = summarise(call), hashlib.sha256()
    with open_source(str(output)) as capture:
        for _, picture in capture:
            pictures.update(picture.tobytes())
    figures: dict[str, Any] = {
        "source": clip.name,
        "frames": summary.frames,
        "model_bytes": summary.model_bytes,
        "frame_bytes": summary.frame_bytes,
        "frame_bps": rounded(summary.frame_bps, 1),
        "events": call_events(call),
        PICTURES: pictures.hexdigest(),
    }
    if clip.original is None:
        return figures
    view = observe_source(clip.original, observer, summary.frames)
    compared = compare(view, str(output), observer, lambda done, total: None, say)
    return figures | compared.figures()


def call_events(call: Path) -> list[dict[str, Any]]:
    """What a call file says of its face, with the times in its source."""
    fps, events = summarise(call).fps, list[dict[str, Any]]()
    for packet, _ in call_packets(call):
        if isinstance(packet, ControlPacket) and packet.kind.name.lower() in EVENTS:
            time_s = round(packet.frame / fps, 3)
            events.append({"event": packet.kind.name.lower(), "time_s": time_s})
    return events
