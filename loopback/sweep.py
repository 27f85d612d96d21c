"""Rate-distortion curves of the default profile: one model of each clip, coded at several rates.

Every point is noted in the folder as soon as it is measured: a sweep that was stopped goes on where
it was, and one with more rates or clips measures only those.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from decoder.pipeline import DecodeOptions, decode
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import RecordedEncoder, send_call
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.options import EncodeOptions
from encoder.pipeline import first_and_second_pass
from loopback.bench import ClipFailure, check_recorded, make_folder, output_names
from loopback.chart import Chart, Curve, layout, picture, svg
from loopback.quality.video_quality import face_mask_finder, measure_quality
from loopback.report import Cell, rounded, table, write_json
from protocol.call_file import CallWriter
from protocol.summary import summarise
from shared_model.errors import UserError

MEAN_CURVE = "mean"
FIGURES = ("frame_bps", "face_psnr_db", "face_psnr_p5_db", "full_psnr_db")


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """Bits per second to code each clip at; how much of it."""

    bitrates: tuple[float, ...]
    max_frames: int | None = None


class Progress(Protocol):
    """Shows one job's progress: what it does, and within it how far it is."""

    def __call__(self, label: str) -> AbstractContextManager[Callable[[int, int | None], None]]: ...


def sweep(
    sources: Sequence[str],
    settings: SweepSettings,
    folder: Path,
    say: Callable[[str], None],
    progress: Progress,
) -> tuple[dict[str, Any], list[ClipFailure]]:
    """Measure each source at each rate.

    Returns the report, with `curves` by clip, each with its `points`, and the sources that failed.
    Writes report.json, rate_distortion.svg and .png into `folder`, and leaves the call files there.
    Raises `UserError` as `check_recorded` does, before anything is coded.
    """
    check_recorded(sources)
    make_folder(folder)
    curves, failures = dict[str, dict[str, Any]](), list[ClipFailure]()
    for source, name in zip(sources, output_names(sources), strict=True):
        try:
            curves[name] = measure_curve(source, folder / name, settings, say, progress)
        except UserError as error:
            failures.append(ClipFailure(source, error))
    mean = mean_curve(list(curves.values()))
    report = {"settings": asdict(settings), "curves": curves, MEAN_CURVE: mean}
    write_json(folder / "report.json", report)
    draw(report, folder)
    return report, failures


def measure_curve(
    source: str,
    stem: Path,
    settings: SweepSettings,
    say: Callable[[str], None],
    progress: Progress,
) -> dict[str, Any]:
    """The points of one source; each is written to the file `stem`.json once it is measured."""
    notes = stem.with_name(f"{stem.name}.json")
    curve = source_identity(source, settings) | {"points": []}
    old = _read_notes(notes)
    if all(old.get(key) == value for key, value in curve.items() if key != "points"):
        curve["points"] = old["points"]
    measured = {point["bitrate"] for point in curve["points"]}
    missing = [rate for rate in settings.bitrates if rate not in measured]
    if missing:
        encoder, stats = _trained_encoder(source, settings, progress(f"{stem.name}: train"))
        for rate in missing:
            say(f"sweep: {stem.name} at {rate:g} bit/s")
            path = stem.with_name(f"{stem.name}-{rate:g}.rzo")
            point = measure_point(encoder, stats, rate, source, path, settings, say, progress)
            curve["points"].append(point)
            _write_notes(notes, curve)
    else:
        say(f"sweep: {stem.name}: measured already")
    asked = [point for point in curve["points"] if point["bitrate"] in settings.bitrates]
    return curve | {"points": sorted(asked, key=lambda point: float(point["bitrate"]))}


def measure_point(
    encoder: RecordedEncoder,
    stats: SessionStats,
    rate: float,
    source: str,
    path: Path,
    settings: SweepSettings,
    say: Callable[[str], None],
    progress: Progress,
) -> dict[str, Any]:
    """Code at `rate` into the call file `path`, decode it, and compare it with the source."""
    with CallWriter(path) as sink:
        send_call(encoder.encode(rate), PacketSender(sink, stats), None, lambda: False)
    decoded = path.with_suffix(".mkv")
    try:
        with progress("decode") as shown:
            decode(DecodeOptions(call_file=path, output=decoded), shown, lambda: False)
        with progress("compare") as shown:
            find_face_mask = face_mask_finder(say)
            quality = measure_quality(
                source, str(decoded), find_face_mask, shown, settings.max_frames
            )
    finally:
        decoded.unlink(missing_ok=True)
    summary = summarise(path)
    return {
        "bitrate": rate,
        "frame_bps": rounded(summary.frame_bps, 1),
        "packet_bps": rounded(summary.packet_bps, 1),
        "model_bytes": summary.model_bytes,
        "groups": {name: rounded(count, 1) for name, count in summary.groups.items()},
        **quality.figures(),
    }


def mean_curve(curves: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """At each rate that all clips were coded at, the mean of their figures."""
    by_rate = [{point["bitrate"]: point for point in curve["points"]} for curve in curves]
    shared = sorted(set.intersection(*(set(points) for points in by_rate))) if by_rate else []
    means: list[dict[str, Any]] = []
    for rate in shared:
        mean: dict[str, Any] = {"bitrate": rate}
        for name in FIGURES:
            values = [points[rate][name] for points in by_rate]
            there = [value for value in values if value is not None]
            mean[name] = rounded(float(np.mean(there))) if there else None
        means.append(mean)
    return means


def sweep_table(report: Mapping[str, Any]) -> str:
    """Each point of each clip, and the means, as a table."""
    header = ("clip", "rate", "model B", "bps", "face dB", "p5", "full dB")
    rows: list[list[Cell]] = []
    for name, points in [*_points(report), (MEAN_CURVE, report[MEAN_CURVE])]:
        rows += [
            [name, point["bitrate"], point.get("model_bytes"), *(point[f] for f in FIGURES)]
            for point in points
        ]
    return table(header, rows)


def draw(report: Mapping[str, Any], folder: Path) -> None:
    """Write the curves of PSNR over the face as rate_distortion.svg and .png.

    Raises `UserError` if they cannot be written.
    """
    named = [(MEAN_CURVE, report[MEAN_CURVE])] if len(report["curves"]) > 1 else []
    curves = tuple(
        Curve(name, found, 4 if name == MEAN_CURVE else 2)
        for name, points in [*named, *_points(report)]
        if (found := _face_points(points))
    )
    if not curves:
        return
    chart = Chart(
        "PSNR of the face, default profile",
        "bits a second of frame packets",
        "dB",
        tuple(report["settings"]["bitrates"]),
        curves,
    )
    marks = layout(chart)
    try:
        (folder / "rate_distortion.svg").write_text(svg(marks), encoding="utf-8")
        (folder / "rate_distortion.png").write_bytes(_png(picture(marks)))
    except OSError as error:
        raise UserError(f"cannot draw into {folder}: {error.strerror}") from error


def source_identity(source: str, settings: SweepSettings) -> dict[str, Any]:
    """What a curve's points must have in common to be one curve."""
    path = Path(source)
    return {
        "source": path.name,
        "source_bytes": path.stat().st_size if path.is_file() else None,
        "max_frames": settings.max_frames,
    }


def _read_notes(notes: Path) -> dict[str, Any]:
    """What `_write_notes` has written; empty if there is no such file."""
    try:
        curve = json.loads(notes.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return curve if isinstance(curve, dict) else {}


def _write_notes(notes: Path, curve: Mapping[str, Any]) -> None:
    """Write whole or not at all, so that a sweep that is stopped leaves what was before."""
    draft = notes.with_suffix(".part")
    write_json(draft, curve)
    draft.replace(notes)


def _trained_encoder(
    source: str,
    settings: SweepSettings,
    progress: AbstractContextManager[Callable[[int, int | None], None]],
) -> tuple[RecordedEncoder, SessionStats]:
    options = EncodeOptions(source=source, profile="default", max_frames=settings.max_frames)
    stats = SessionStats()
    with open_source(source) as capture, progress as shown:
        return first_and_second_pass(
            options, capture, stats, SessionCallbacks(shown, lambda: False)
        ), stats


def _points(report: Mapping[str, Any]) -> list[tuple[str, list[dict[str, Any]]]]:
    return [(name, curve["points"]) for name, curve in report["curves"].items()]


def _face_points(points: Sequence[Mapping[str, Any]]) -> tuple[tuple[float, float], ...]:
    there = [p for p in points if p["face_psnr_db"] is not None and p["frame_bps"] > 0]
    return tuple((p["frame_bps"], p["face_psnr_db"]) for p in there)


def _png(image: np.ndarray[Any, np.dtype[np.uint8]]) -> bytes:
    done, data = cv2.imencode(".png", image)
    assert done
    return data.tobytes()
