"""What is held against the figures of a clip: thresholds, a baseline, events, pictures."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loopback.figures import less_is_better
from loopback.report import Cell, flatten, rounded, table, write_report
from shared_model.errors import UserError

# By how much a figure may be worse than the baseline where a suite does not say it.
TOLERANCES = {
    "face_psnr_db": 0.3,
    "full_psnr_db": 0.3,
    "face_ssimulacra2": 2.0,
    "frame_bps": 20.0,
    "model_bytes": 300.0,
    "lost_frames": 0.0,
}
PICTURES = "pictures_sha256"
EVENTS = ("face_lost", "face_found", "person_gone")


@dataclass(frozen=True, slots=True)
class Check:
    """One rule and what was measured; `value` None: the clip has no such figure."""

    figure: str
    rule: str
    value: Cell
    passed: bool


@dataclass(frozen=True, slots=True)
class ExpectedEvent:
    """Something that a call must say between two times of its source, seconds."""

    kind: str
    from_s: float
    to_s: float

    def check(self, events: Iterable[Mapping[str, Any]]) -> Check:
        """Hold it against the events of a report."""
        times = [event["time_s"] for event in events if event["event"] == self.kind]
        passed = any(self.from_s <= time <= self.to_s for time in times)
        said = ", ".join(f"{time:.2f} s" for time in times) or None
        return Check(self.kind, f"{self.from_s:g} to {self.to_s:g} s", said, passed)


def check_limits(
    figures: Mapping[str, Any], least: Mapping[str, float], most: Mapping[str, float]
) -> Iterator[Check]:
    """Hold figures against thresholds by their dotted names."""
    flat = dict(flatten(figures))
    for figure, limit in least.items():
        value = _number(flat.get(figure))
        yield Check(figure, f">= {limit:g}", value, value is not None and value >= limit)
    for figure, limit in most.items():
        value = _number(flat.get(figure))
        yield Check(figure, f"<= {limit:g}", value, value is not None and value <= limit)


def check_baseline(
    figures: Mapping[str, Any], before: Mapping[str, Any], tolerances: Mapping[str, float]
) -> Iterator[Check]:
    """Hold figures against earlier ones: none may be worse by more than its tolerance.

    A figure that the baseline does not have is not held.
    """
    flat = dict(flatten(figures))
    if (expected := before.get(PICTURES)) is not None:
        found = flat.get(PICTURES)
        yield Check(PICTURES, f"is {expected[:12]}", str(found)[:12], found == expected)
    for figure, tolerance in tolerances.items():
        known, value = _number(before.get(figure)), _number(flat.get(figure))
        if known is None:
            continue
        is_less = less_is_better(figure)
        limit = known + tolerance if is_less else known - tolerance
        passed = value is not None and (value <= limit if is_less else value >= limit)
        rule = f"{'<=' if is_less else '>='} {known:g} {'+' if is_less else '-'} {tolerance:g}"
        yield Check(figure, rule, value, passed)


def read_baseline(path: Path) -> dict[str, dict[str, Any]]:
    """The figures of each clip, as `write_baseline` has written them.  Raises `UserError`."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        clips: dict[str, dict[str, Any]] = content["clips"]
        if not all(isinstance(figures, dict) for figures in clips.values()):
            raise TypeError
    except OSError as error:
        raise UserError(
            f"cannot read the baseline {path}: {error.strerror}; --update-baseline writes one"
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{path} is no baseline of risorius replay") from error
    return clips


def baseline_of(figures: Mapping[str, Any], tolerances: Mapping[str, float]) -> dict[str, Any]:
    """What a baseline keeps of a clip: the figures that are held, and the hash of its pictures."""
    flat = dict(flatten(figures))
    kept = {name: rounded(_number(flat.get(name)), 3) for name in sorted(tolerances)}
    known = {name: value for name, value in kept.items() if value is not None}
    return known | ({PICTURES: flat[PICTURES]} if PICTURES in flat else {})


def write_baseline(path: Path, clips: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the baselines of clips, a figure a line, so that a change can be reviewed."""
    text = json.dumps({"clips": clips}, indent=2, sort_keys=True, allow_nan=False)
    write_report(path, f"{text}\n".encode())


def baseline_changes(
    before: Mapping[str, Mapping[str, Any]], after: Mapping[str, Mapping[str, Any]]
) -> str:
    """What differs, as a table; empty if nothing does."""
    rows: list[Sequence[Cell]] = []
    for clip, figures in after.items():
        old = before.get(clip, {})
        rows += [
            (clip, name, _cell(old.get(name)), _cell(value))
            for name, value in figures.items()
            if old.get(name) != value
        ]
    rows += [(clip, "-", "measured", "gone") for clip in before if clip not in after]
    return table(("clip", "figure", "before", "now"), rows) if rows else ""


def _number(value: Any) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _cell(value: Any) -> Cell:
    return value[:12] if isinstance(value, str) else value
