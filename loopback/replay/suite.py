"""Suites as their TOML files say them: clips, how they are coded, what is held against them."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from encoder.option_rules import check_values, checked_options
from loopback.bench import (
    ENCODER_OPTIONS,
    BenchSettings,
    check_recorded,
    encoder_options,
    is_figure,
)
from loopback.clip_paths import clip_path
from loopback.replay.checks import EVENTS, TOLERANCES, ExpectedEvent
from loopback.report import flatten
from loopback.toml_file import read_toml
from shared_model.errors import UserError

CLIP_KEYS = {
    *("name", "path", "sha256", "settings", "min", "max"),
    *("tolerance", "event", "original"),
}
CALL_FILE = ".rzo"
# Settings that are no options of the encoder, and their defaults.
OF_THE_BENCH = {"busy": 0, "cores": None}
BUSY_LOOPS = range(17)


@dataclass(frozen=True, slots=True)
class Clip:
    """One clip of a suite.

    path: video file, image pattern, or call file.  sha256: of the file, hexadecimal; None for an
        image pattern.
    least, most: thresholds by the dotted name of a report figure.
    tolerances: by how much a figure may be worse than the baseline.
    events: that the call must say.
    original: of a call file, what it was made of; None: its pictures are compared with nothing.
    """

    name: str
    path: str
    sha256: str | None
    settings: BenchSettings
    least: Mapping[str, float] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)
    tolerances: Mapping[str, float] = field(default_factory=lambda: dict(TOLERANCES))
    events: tuple[ExpectedEvent, ...] = ()
    original: str | None = None

    @property
    def is_call(self) -> bool:
        """Whether it is a recorded call, which goes straight into a decoder."""
        return self.path.endswith(CALL_FILE)


@dataclass(frozen=True, slots=True)
class Suite:
    """Clips to replay, in order."""

    name: str
    clips: tuple[Clip, ...]


def read_suite(path: Path) -> Suite:
    """Read a suite; paths are relative to its folder.

    Raises `UserError` for a mistake; one that is in a clip together with those of the other clips
    and of their files.
    """
    content = read_toml(path, "a suite")
    entries = content.get("clip")
    if not isinstance(entries, list) or not entries:
        raise UserError(f"{path} has no [[clip]]")
    if unknown := set(content) - {"name", "settings", "tolerance", "clip"}:
        raise UserError(f"{path}: unknown keys: {' '.join(sorted(unknown))}")
    defaults = _table(content, "settings", f"{path}")
    tolerances = {**TOLERANCES, **_thresholds(content, "tolerance", f"{path}")}
    clips, faults = list[Clip](), list[str]()
    for entry in entries:
        try:
            clips.append(_read_clip(entry, defaults, tolerances, path))
        except UserError as error:
            faults.append(str(error))
    if faults:
        raise UserError("; ".join([*faults, *_input_faults(clips)]))
    return Suite(str(content.get("name", path.stem)), tuple(clips))


def check_inputs(suite: Suite) -> None:
    """Raise `UserError` that names each clip that cannot be read or is another file than meant."""
    if faults := _input_faults(suite.clips):
        raise UserError("; ".join(faults))


def _input_faults(clips: Iterable[Clip]) -> list[str]:
    """What is wrong with the files of clips, a line for each clip."""
    faults = []
    for clip in clips:
        try:
            _check_readable(clip)
            _check_sha256(clip)
        except UserError as error:
            faults.append(f"clip {clip.name}: {error}")
    return faults


def _check_readable(clip: Clip) -> None:
    if not clip.is_call:
        check_recorded([clip.path])
    elif not Path(clip.path).is_file():
        raise UserError(f"cannot read {clip.path}: no such file")
    if clip.original is not None:
        check_recorded([clip.original])


def _check_sha256(clip: Clip) -> None:
    if clip.sha256 is None:
        return
    with open(clip.path, "rb") as file:
        actual = hashlib.file_digest(file, "sha256").hexdigest()
    if actual != clip.sha256.lower():
        raise UserError(f"{clip.path} is another file than the suite means: sha256 is {actual}")


def _read_clip(
    entry: Any, defaults: Mapping[str, Any], tolerances: Mapping[str, float], path: Path
) -> Clip:
    if not isinstance(entry, dict) or not isinstance(entry.get("path"), str):
        raise UserError(f"{path}: a [[clip]] has no path")
    name = str(entry.get("name", Path(entry["path"]).name))
    place = f"{path}: clip {name}"
    if unknown := set(entry) - CLIP_KEYS:
        raise UserError(f"{place}: unknown keys: {' '.join(sorted(unknown))}")
    sha256 = entry.get("sha256")
    if sha256 is None and "%" not in entry["path"]:
        raise UserError(f"{place} has no sha256; sha256sum prints it")
    return Clip(
        name=name,
        path=str(clip_path(entry["path"], path.parent)),
        sha256=sha256,
        settings=_settings({**defaults, **_table(entry, "settings", place)}, place),
        least=_thresholds(entry, "min", place),
        most=_thresholds(entry, "max", place),
        tolerances={**tolerances, **_thresholds(entry, "tolerance", place)},
        events=_events(entry.get("event", []), place),
        original=_original(entry.get("original"), path.parent, place),
    )


def _original(value: Any, folder: Path, place: str) -> str | None:
    if value is not None and not isinstance(value, str):
        raise UserError(f"{place}: original is not a path")
    return None if value is None else str(clip_path(value, folder))


def _events(entries: Any, place: str) -> tuple[ExpectedEvent, ...]:
    if not isinstance(entries, list):
        raise UserError(f"{place}: event is not a list of tables: [[clip.event]]")
    return tuple(_event(entry, place) for entry in entries)


def _event(entry: Any, place: str) -> ExpectedEvent:
    kind = entry.get("kind") if isinstance(entry, dict) else None
    if kind not in EVENTS:
        raise UserError(f"{place}: an event's kind is one of {', '.join(EVENTS)}")
    between = entry.get("between_s")
    is_pair = isinstance(between, list) and len(between) == 2
    if not is_pair or not all(isinstance(time, int | float) for time in between):
        raise UserError(f"{place}: event {kind}: between_s is not a pair of seconds")
    if unknown := set(entry) - {"kind", "between_s"}:
        raise UserError(f"{place}: event {kind}: unknown keys: {' '.join(sorted(unknown))}")
    return ExpectedEvent(kind, *map(float, between))


def _settings(content: Mapping[str, Any], place: str) -> BenchSettings:
    known = {**ENCODER_OPTIONS, **OF_THE_BENCH}
    if unknown := set(content) - set(known):
        raise UserError(
            f"{place}: unknown settings {' '.join(sorted(unknown))}, of {sorted(known)}"
        )
    for name, value in content.items():
        is_switch = isinstance(known[name], bool)
        if isinstance(value, bool) != is_switch:
            kind = "true or false" if is_switch else "neither true nor false"
            raise UserError(f"{place}: expected {kind} for {name}")
    of_bench = {name: value for name, value in content.items() if name in OF_THE_BENCH}
    try:
        check_values(content)
        _check_of_bench(**of_bench)
        # Without a profile: it follows from the others, as on a command line.
        options = {**ENCODER_OPTIONS, "profile": None, **content}
        given = checked_options(options, _as_setting, otherwise=str(ENCODER_OPTIONS["profile"]))
    except (ValueError, UserError) as error:
        raise UserError(f"{place}: {error}") from error
    return BenchSettings(encoder_options(given), **of_bench)


def _check_of_bench(busy: object = 0, cores: object = None) -> None:
    """Raise `ValueError` for a value that a setting of `OF_THE_BENCH` cannot have."""
    if not isinstance(busy, int) or busy not in BUSY_LOOPS:
        raise ValueError(f"busy: {busy} is no whole number from 0 to {BUSY_LOOPS[-1]}")
    is_list = isinstance(cores, str) and all(core.isdecimal() for core in cores.split(","))
    if cores is not None and not is_list:
        raise ValueError(f'cores: {cores} is no text of numbers as in "0,1"')


def _as_setting(name: str, value: object) -> str:
    return f"{name} = {json.dumps(value)}"


def _thresholds(content: Mapping[str, Any], key: str, place: str) -> dict[str, float]:
    limits = dict(flatten(_table(content, key, place)))
    wrong = [name for name, limit in limits.items() if not isinstance(limit, int | float)]
    if wrong:
        raise UserError(f"{place}: {key} of {wrong[0]} is not a number")
    if unknown := [name for name in limits if not is_figure(name)]:
        raise UserError(f"{place}: {key}: no report has a figure {unknown[0]}; see docs/replay.md")
    return limits


def _table(content: Mapping[str, Any], key: str, place: str) -> dict[str, Any]:
    value = content.get(key, {})
    if not isinstance(value, dict):
        raise UserError(f"{place}: {key} is not a table")
    return value
