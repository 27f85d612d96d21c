"""Suites of recorded clips with thresholds: what a CI runs to see that nothing got worse."""

import hashlib
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from encoder.option_rules import check_value, chosen_profile
from loopback.bench import (
    BenchSettings,
    bench_clip,
    check_recorded,
    is_figure,
    make_folder,
    output_names,
)
from loopback.clip_paths import clip_path
from loopback.judge.observer import Observer, find_observer
from loopback.report import flatten, table
from loopback.toml_file import read_toml
from shared_model.errors import UserError

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Clip:
    """One clip of a suite.

    path: file or image pattern.  sha256: of the file, hexadecimal; None for an image pattern.
    least, most: thresholds by the dotted name of a report figure.
    """

    name: str
    path: str
    sha256: str | None
    settings: BenchSettings
    least: Mapping[str, float] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Suite:
    """Clips to replay, in order."""

    name: str
    clips: tuple[Clip, ...]


@dataclass(frozen=True, slots=True)
class Check:
    """One threshold and what was measured; `value` None: the clip has no such figure."""

    figure: str
    rule: str
    value: float | None
    passed: bool


@dataclass(frozen=True, slots=True)
class ClipResult:
    """What came of one clip; `error`: why it could not be measured."""

    name: str
    figures: Mapping[str, Any]
    checks: tuple[Check, ...]
    error: str | None

    @property
    def passed(self) -> bool:
        """It was measured and no threshold was missed."""
        return self.error is None and all(check.passed for check in self.checks)


def read_suite(path: Path) -> Suite:
    """Read a suite; paths are relative to its folder.

    Raises `UserError` for a mistake; one that is in a clip together with those of the other clips
    and of their files.
    """
    content = read_toml(path, "a suite")
    entries = content.get("clip")
    if not isinstance(entries, list) or not entries:
        raise UserError(f"{path} has no [[clip]]")
    if unknown := set(content) - {"name", "settings", "clip"}:
        raise UserError(f"{path}: unknown keys: {' '.join(sorted(unknown))}")
    defaults = _table(content, "settings", f"{path}")
    clips, faults = list[Clip](), list[str]()
    for entry in entries:
        try:
            clips.append(_read_clip(entry, defaults, path))
        except UserError as error:
            faults.append(str(error))
    if faults:
        raise UserError("; ".join([*faults, *_input_faults(clips)]))
    return Suite(str(content.get("name", path.stem)), tuple(clips))


def replay(suite: Suite, folder: Path, say: Say) -> Iterator[ClipResult]:
    """Measure one clip of the suite after the other; decoded videos stay in `folder`.

    Raises `UserError` as `check_inputs` does, before anything runs.
    """
    check_inputs(suite)
    names = output_names([clip.name for clip in suite.clips])
    observer = find_observer()
    make_folder(folder)
    for clip, name in zip(suite.clips, names, strict=True):
        say(f"replay: {clip.name}")
        yield _replay_clip(clip, folder / f"{name}.mkv", observer, say)


def check_inputs(suite: Suite) -> None:
    """Raise `UserError` that names each clip that cannot be read or is not the one meant."""
    if faults := _input_faults(suite.clips):
        raise UserError("; ".join(faults))


def check(clip: Clip, figures: Mapping[str, Any]) -> tuple[Check, ...]:
    """Hold the figures of a report against the clip's thresholds."""
    flat = dict(flatten(figures))
    least = [_check(flat, figure, ">=", limit) for figure, limit in clip.least.items()]
    most = [_check(flat, figure, "<=", limit) for figure, limit in clip.most.items()]
    return (*least, *most)


def replay_table(results: list[ClipResult]) -> str:
    """Each threshold of each clip with what was measured."""
    rows: list[list[str | float | None]] = []
    for result in results:
        rows += [
            [result.name, check.figure, check.rule, check.value, "ok" if check.passed else "MISSED"]
            for check in result.checks
        ]
        if result.error is not None:
            rows.append([result.name, "-", result.error, None, "FAILED"])
        elif not result.checks:
            rows.append([result.name, "-", "none", None, "ok"])
    return table(("clip", "figure", "threshold", "measured", ""), rows)


def junit_xml(suite: Suite, results: list[ClipResult]) -> bytes:
    """The results as JUnit XML: one test case for each threshold, or for a clip that failed."""
    root = ElementTree.Element("testsuite", name=suite.name)
    for result in results:
        for item in result.checks:
            case = _case(root, result.name, f"{item.figure} {item.rule}")
            if not item.passed:
                ElementTree.SubElement(case, "failure", message=f"measured {item.value}")
        if result.error is not None:
            ElementTree.SubElement(_case(root, result.name, "run"), "error", message=result.error)
        elif not result.checks:
            _case(root, result.name, "run")
    root.set("tests", str(len(root)))
    root.set("failures", str(len(root.findall("testcase/failure"))))
    root.set("errors", str(len(root.findall("testcase/error"))))
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _replay_clip(clip: Clip, output: Path, observer: Observer, say: Say) -> ClipResult:
    try:
        figures = bench_clip(clip.path, clip.settings, output, observer, say)
    except UserError as error:
        return ClipResult(clip.name, {"source": clip.name}, (), str(error))
    return ClipResult(clip.name, figures, check(clip, figures), None)


def _input_faults(clips: Iterable[Clip]) -> list[str]:
    """What is wrong with the files of clips, a line for each clip."""
    faults = []
    for clip in clips:
        try:
            check_recorded([clip.path])
            _check_sha256(clip)
        except UserError as error:
            faults.append(f"clip {clip.name}: {error}")
    return faults


def _check_sha256(clip: Clip) -> None:
    if clip.sha256 is None:
        return
    with open(clip.path, "rb") as file:
        actual = hashlib.file_digest(file, "sha256").hexdigest()
    if actual != clip.sha256.lower():
        raise UserError(f"{clip.path} is another file than the suite means: sha256 is {actual}")


def _check(flat: Mapping[str, Any], figure: str, relation: str, limit: float) -> Check:
    value = flat.get(figure)
    if not isinstance(value, int | float):
        return Check(figure, f"{relation} {limit:g}", None, False)
    passed = value >= limit if relation == ">=" else value <= limit
    return Check(figure, f"{relation} {limit:g}", value, passed)


def _case(root: ElementTree.Element, clip: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(
        root, "testcase", classname=f"{root.get('name')}.{clip}", name=name
    )


def _read_clip(entry: Any, defaults: Mapping[str, Any], path: Path) -> Clip:
    if not isinstance(entry, dict) or not isinstance(entry.get("path"), str):
        raise UserError(f"{path}: a [[clip]] has no path")
    name = str(entry.get("name", Path(entry["path"]).name))
    place = f"{path}: clip {name}"
    if unknown := set(entry) - {"name", "path", "sha256", "settings", "min", "max"}:
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
    )


def _settings(content: Mapping[str, Any], place: str) -> BenchSettings:
    known = {item.name for item in fields(BenchSettings)}
    if unknown := set(content) - known:
        raise UserError(
            f"{place}: unknown settings {' '.join(sorted(unknown))}, of {sorted(known)}"
        )
    for item in fields(BenchSettings):
        is_switch = isinstance(item.default, bool)
        if item.name in content and isinstance(content[item.name], bool) != is_switch:
            kind = "true or false" if is_switch else "neither true nor false"
            raise UserError(f"{place}: expected {kind} for {item.name}")
    settings = BenchSettings(**content)
    for name, value in content.items():
        try:
            check_value(name, value)
        except ValueError as error:
            raise UserError(f"{place}: {name}: {error}") from error
    try:
        chosen_profile(asdict(settings), _as_setting)
    except UserError as error:
        raise UserError(f"{place}: {error}") from error
    return settings


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
