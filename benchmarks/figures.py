"""Measure clips in every way and write the tables of docs/measurements.md.

    make figures CLIPS="carphone.mp4 akiyo.mp4 ..."      # or
    python -m benchmarks figures CLIP... [--out DIR] [--only recorded curves ...]

A set whose report is in DIR already is not measured again.  Speed and paced calls mean something
only if the computer has nothing else to do.  Paced calls are measured with slower clocks, as on a
faster host, see `slow_clock`: set `CLOCK_RATE` for other cores.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote

import numpy as np

from benchmarks.browser import Browser, find_browser
from benchmarks.command import PROGRAM, run
from loopback.bench import check_recorded, mean_figures
from loopback.curves.curve_bench import OURS, Duel, duel_rows
from loopback.curves.curve_page import mean_figure
from loopback.curves.points import MEASURES, Point
from loopback.report import markdown_table, write_report
from loopback.report_page import chart, page, plotly_graphs
from shared_model.errors import UserError

MEASUREMENTS = Path(__file__).resolve().parent.parent / "docs" / "measurements.md"
FRAMES, FEW_FRAMES = 300, 150
# Options of each `risorius bench` of a set, by the folder of its report.
SETS = {
    "recorded": {"recorded": ["--no-pace"]},
    "live": {"live": ["--live", "--no-pace"]},
    "paced": {"paced": ["--live"]},
    "busy": {"busy": ["--live", "--busy", "1"]},
    "thesis": {
        "thesis": ["--profile", "thesis", "--no-pace"],
        "thesis-modes": ["--profile", "thesis", "--texture-modes", "8", "--no-pace"],
        "thesis-builtin": ["--profile", "thesis", "--aam", "builtin", "--no-pace"],
        "thesis-literal": ["--preset", "thesis-literal", "--no-pace"],
    },
    "rungs": {
        "2000": ["--bitrate", "2000", "--model-bytes", "30000", "--no-pace"],
        "5000": ["--bitrate", "5000", "--model-bytes", "60000", "--no-pace"],
        "16000": ["--bitrate", "16000", "--model-bytes", "100000", "--no-pace"],
        "live-5000": ["--live", "--bitrate", "5000", "--no-pace"],
    },
    "curves": {"curves": ["--against", "svtav1,x265,x264,vp9"]},
}
# Sets in real time, and the rate of the clocks that they are measured by, see `slow_clock`: on the
# cores that the tables come from Python then adds five million times in about .33 s.
PACED_SETS, CLOCK_RATE = ("paced", "busy"), 0.42
# Of these so many frames are measured, which take long.
SHORT_SETS = ("rungs", "curves")
# Columns of a table by the name of their figure, with digits.
COLUMNS = {
    "face_psnr_db": ("face, dB", 1),
    "face_psnr_p5_db": ("5th percentile", 1),
    "full_psnr_db": ("whole picture", 1),
    "person_psnr_db": ("person but face", 1),
    "background_psnr_db": ("behind", 1),
    "face_ssimulacra2": ("SSIMULACRA2 face", 0),
    "blink_ssimulacra2": ("of blinks", 0),
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
DURATIONS_S = (10.0, 60.0)


def marks(name: str) -> tuple[str, str]:
    """The lines in docs/measurements.md around a table."""
    return f"<!-- figures: {name} -->\n", f"<!-- end of figures: {name} -->\n"


def commands(name: str, clips: Sequence[str], out: Path) -> dict[Path, list[str]]:
    """The arguments of `risorius` that measure a set, by the folders that their reports go to."""
    frames = ["--max-frames", str(_frames(name))]
    return {
        out / folder: ["bench", *options, *clips, *frames, "--out", str(out / folder)]
        for folder, options in SETS[name].items()
    }


def markdown(name: str, reports: Sequence[Mapping[str, Any]]) -> str:
    """The table of a set of reports, and the commands that have measured them."""
    if name == "curves":
        return _curves_markdown(reports[0])
    if len(reports) > 1:
        return _ways_markdown(name, reports)
    clips = reports[0]["clips"]
    columns = COLUMNS | (PACED_COLUMN if name in PACED_SETS else {})
    rows = [[Path(clip["source"]).stem, *_figures(clip, columns)] for clip in clips]
    mean = mean_figures(clips)
    rows.append(["**mean**", *_figures(mean, columns)])
    header = ["clip", *(title for title, _ in columns.values())]
    return _shown_commands(name) + _table(header, rows)


def _ways_markdown(name: str, reports: Sequence[Mapping[str, Any]]) -> str:
    """A row for each bench of a set: means over the clips, and the face's PSNR in each."""
    rows = []
    for folder, report in zip(SETS[name], reports, strict=True):
        clips, face = report["clips"], "face_psnr_db"
        each = [_number(clip.get(face), COLUMNS[face][1]) for clip in clips]
        rows.append([folder, *_figures(mean_figures(clips), COLUMNS), *each])
    sources = [Path(clip["source"]).stem for clip in reports[0]["clips"]]
    header = ["", *(title for title, _ in COLUMNS.values()), *sources]
    text = "Means over the clips; by a clip's name the PSNR of its face, dB:\n\n"
    return _shown_commands(name) + text + _table(header, rows)


def _curves_markdown(report: Mapping[str, Any]) -> str:
    clips = report["clips"]
    text = _shown_commands("curves")
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
        text += f"\nAgainst our `{report['rung']}`, a call of {duration:g} s:"
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


def _frames(name: str) -> int:
    """How many frames of each clip a set measures."""
    return FEW_FRAMES if name in SHORT_SETS else FRAMES


def _shown_commands(name: str) -> str:
    """What measures a set; which row is of which command, where there are several."""
    frames, prefix = _frames(name), ""
    if name in PACED_SETS:
        prefix = f"python -m benchmarks slow_clock {CLOCK_RATE} "
    lines = {
        folder: f"    {prefix}risorius bench {' '.join(options)} CLIP... --max-frames {frames}"
        for folder, options in SETS[name].items()
    }
    if len(lines) > 1:
        width = max(map(len, lines.values()))
        lines = {folder: f"{line:<{width}}  # {folder}" for folder, line in lines.items()}
    return "\n".join(lines.values()) + "\n\n"


def _figures(clip: Mapping[str, Any], columns: Mapping[str, tuple[str, int]]) -> list[str]:
    return [_number(clip.get(name), digits) for name, (_, digits) in columns.items()]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return f"{markdown_table(header, rows)}\n"


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
        reports = []
        for folder, command in commands(name, options.clip, options.out).items():
            report = folder / "report.json"
            if not is_whole(report, len(options.clip)):
                done = subprocess.run([*_clock(name), *PROGRAM, *command])
                if done.returncode or not report.is_file():
                    raise UserError(f"the set {name} failed")
            reports.append(json.loads(report.read_text(encoding="utf-8")))
        text = replaced(text, name, markdown(name, reports))
        MEASUREMENTS.write_text(text, encoding="utf-8")
        if name == "curves":
            draw_curves(reports[0], MEASUREMENTS.parent / "figures" / "curves.svg")


def _clock(name: str) -> list[str]:
    """What a set's command is run by."""
    if name not in PACED_SETS:
        return []
    return [sys.executable, "-m", "benchmarks", "slow_clock", str(CLOCK_RATE)]


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


def write_svg(figure: Any, path: Path, width: int, height: int) -> None:
    """Draw a figure into an SVG file, pixels.  Raises `UserError` if there is no browser."""
    program = find_browser()
    if program is None:
        raise UserError("pictures of charts need Chromium: apt-get install chromium")
    with TemporaryDirectory() as folder:
        html = Path(folder) / "figure.html"
        html.write_bytes(page("figure", [chart(figure)]))
        with Browser(program, Path(folder) / "profile", width, height) as browser:
            browser.call("Page.navigate", url=html.as_uri())
            browser.wait("document.querySelectorAll('.main-svg').length > 0")
            browser.value(
                "Plotly.toImage(document.querySelector('.plotly-graph-div'),"
                f" {{format: 'svg', width: {width}, height: {height}}})"
                ".then(url => { window.drawn = url; }), 0"
            )
            browser.wait("Boolean(window.drawn)")
            url = str(browser.value("window.drawn"))
    write_report(path, unquote(url.split(",", 1)[1]).encode())


if __name__ == "__main__":
    run(main)
