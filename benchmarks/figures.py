"""Measure clips in every way and write the tables of docs/measurements.md.

    make figures CLIPS="carphone.mp4 akiyo.mp4 ..."      # or
    python -m benchmarks figures CLIP... [--out DIR] [--only recorded curves ...]

A set whose report is in DIR already is not measured again.  Speed and paced calls mean something
only if the computer has nothing else to do.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import run
from benchmarks.figure_image import write_svg
from loopback.bench import check_recorded, mean_figures
from loopback.curves.curve_bench import OURS, Duel, duel_rows
from loopback.curves.curve_page import mean_figure
from loopback.curves.points import MEASURES, Point
from loopback.report_page import plotly_graphs
from shared_model.errors import UserError

MEASUREMENTS = Path(__file__).resolve().parent.parent / "docs" / "measurements.md"
FRAMES, CURVE_FRAMES = 300, 150
# Options of `risorius bench` for each set.
SETS = {
    "recorded": ["--no-pace"],
    "live": ["--live", "--no-pace"],
    "paced": ["--live"],
    "busy": ["--live", "--busy", "1"],
    "thesis": ["--profile", "thesis", "--no-pace"],
    "curves": ["--against", "svtav1,x265,x264,vp9"],
}
# Columns of a table by the name of their figure, with digits.
COLUMNS = {
    "face_psnr_db": ("face, dB", 1),
    "face_psnr_p5_db": ("5th percentile", 1),
    "full_psnr_db": ("whole picture", 1),
    "person_psnr_db": ("person but face", 1),
    "background_psnr_db": ("behind", 1),
    "face_ssimulacra2": ("SSIMULACRA2 face", 0),
    "picture_ssimulacra2": ("of picture", 0),
    "flicker_ratio": ("flicker", 2),
    "jitter_ratio": ("jitter", 2),
    "identity": ("identity", 2),
    "nme_percent": ("landmarks off, %", 1),
    "mouth_corr": ("mouth", 2),
    "blink_corr": ("lids", 2),
    "model_bytes": ("model, bytes", 0),
    "frame_bps": ("frames, bit/s", 0),
}
PACED_COLUMN = {"overloaded_frames": ("in haste", 0)}
DURATIONS_S = (10.0, 60.0, 0.0)


def marks(name: str) -> tuple[str, str]:
    """The lines in docs/measurements.md around a table."""
    return f"<!-- figures: {name} -->\n", f"<!-- end of figures: {name} -->\n"


def command(name: str, clips: Sequence[str], folder: Path) -> list[str]:
    """The arguments of `risorius` that measure a set."""
    frames = CURVE_FRAMES if name == "curves" else FRAMES
    tail = ["--max-frames", str(frames), "--out", str(folder)]
    return ["bench", *SETS[name], *clips, *tail]


def markdown(name: str, report: Mapping[str, Any]) -> str:
    """The table of a set, and the command that has measured it."""
    if name == "curves":
        return _curves_markdown(report)
    clips = report["clips"]
    columns = COLUMNS | (PACED_COLUMN if name in ("paced", "busy") else {})
    rows = [[Path(clip["source"]).stem, *_figures(clip, columns)] for clip in clips]
    mean = mean_figures(clips)
    rows.append(["**mean**", *_figures(mean, columns)])
    header = ["clip", *(title for title, _ in columns.values())]
    return _shown_command(name) + _table(header, rows)


def _curves_markdown(report: Mapping[str, Any]) -> str:
    clips = report["clips"]
    text = _shown_command("curves")
    labels = [point["label"] for point in next(iter(clips.values()))[OURS]]
    rows = []
    for label in labels:
        points = [p for each in clips.values() for p in each[OURS] if p["label"] == label]
        means = [np.mean([p["figures"][measure] for p in points]) for measure in MEASURES]
        start, rate = (np.mean([p[key] for p in points]) for key in ("start_bytes", "steady_bps"))
        numbers = [f"{start / 1000:.1f}", f"{rate:.0f}"]
        rows.append(
            [
                label,
                *numbers,
                *(f"{mean:.{d}f}" for mean, d in zip(means, (1, 0, 1, 0), strict=True)),
            ]
        )
    header = ["asked for", "model, kB", "frames, bit/s"]
    text += _table([*header, "face, dB", "SSIMULACRA2 face", "picture, dB", "of picture"], rows)
    duels = [Duel(**each) for each in report["duels"]]
    for duration in DURATIONS_S:
        length = f"a call of {duration:g} s" if duration else "what follows the start"
        text += f"\nAgainst our `{report['rung']}`, {length}:"
        text += " needs, overtakes at, kbit/s; BD-rate, %\n\n"
        text += _duel_table(duels, duration)
    return text


def _duel_table(duels: Sequence[Duel], duration_s: float) -> str:
    """A row for each rival, a column for each measure."""
    cells: dict[str, dict[str, str]] = {}
    for rival, measure, _, _, *rates in duel_rows(duels, duration_s)[1]:
        shown = "; ".join("-" if rate is None else str(rate) for rate in rates)
        cells.setdefault(str(rival), {})[str(measure)] = shown
    rows = [[rival, *(each.get(m, "-") for m in MEASURES)] for rival, each in cells.items()]
    return _table(["rival", "face, dB", "SSIMULACRA2 face", "picture, dB", "of picture"], rows)


def replaced(text: str, name: str, table: str) -> str:
    """The text of docs/measurements.md with another table between its marks.

    Raises `ValueError` if the marks are not there.
    """
    begin, end = marks(name)
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return before + begin + table + end + after


def _shown_command(name: str) -> str:
    frames = CURVE_FRAMES if name == "curves" else FRAMES
    return f"    risorius bench {' '.join(SETS[name])} CLIP... --max-frames {frames}\n\n"


def _figures(clip: Mapping[str, Any], columns: Mapping[str, tuple[str, int]]) -> list[str]:
    return [_number(clip.get(name), digits) for name, (_, digits) in columns.items()]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [list(header), ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def main(arguments: Sequence[str]) -> None:
    """Measure what is missing, and rewrite docs/measurements.md."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("clip", nargs="+", help="video file")
    parser.add_argument("--out", type=Path, default=Path("out/figures"), help="reports go here")
    parser.add_argument("--only", nargs="+", choices=SETS, default=list(SETS), help="these sets")
    options: Any = parser.parse_args(arguments)
    check_recorded(options.clip)
    text = MEASUREMENTS.read_text(encoding="utf-8")
    for name in options.only:
        folder = options.out / name
        report = folder / "report.json"
        if not is_whole(report, len(options.clip)):
            risorius = [sys.executable, "-m", "risorius"]
            done = subprocess.run([*risorius, *command(name, options.clip, folder)])
            if done.returncode or not report.is_file():
                raise UserError(f"the set {name} failed")
        content = json.loads(report.read_text(encoding="utf-8"))
        text = replaced(text, name, markdown(name, content))
        MEASUREMENTS.write_text(text, encoding="utf-8")
        if name == "curves":
            draw_curves(content, MEASUREMENTS.parent / "figures" / "curves.svg")


def is_whole(report: Path, clips: int) -> bool:
    """Whether a report is there and has so many clips: one that was broken off has fewer."""
    if not report.is_file():
        return False
    return len(json.loads(report.read_text(encoding="utf-8"))["clips"]) == clips


def draw_curves(report: Mapping[str, Any], path: Path) -> None:
    """The curves of a bench, mean over its clips, in calls of a minute."""
    clips = {
        name: {codec: [Point(**point) for point in points] for codec, points in each.items()}
        for name, each in report["clips"].items()
    }
    figure = mean_figure(plotly_graphs(), clips)
    figure.layout.updatemenus = []
    figure.update_layout(font_size=13, margin={"l": 40, "r": 10, "t": 30, "b": 40})
    write_svg(figure, path, 960, 640)


if __name__ == "__main__":
    run(main)
