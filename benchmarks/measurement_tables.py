"""Put the figures of benches into docs/measurements.md: a table per profile, between its marks.

    risorius bench CLIP... --profile thesis --out DIR/thesis
    risorius bench CLIP... --profile default --out DIR/default
    risorius bench CLIP... --profile default --live --no-pace --out DIR/live
    python -m benchmarks measurement_tables [--without-times] DIR/*/report.json

A profile whose report is not named keeps the table that it has.  Times mean something only if the
host had nothing else to do.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.command import run
from loopback.report import figure

Cells = Mapping[str, Any]
MEASUREMENTS = Path(__file__).resolve().parent.parent / "docs" / "measurements.md"


def _plain(name: str, digits: int) -> Callable[[Cells], str]:
    return lambda clip: _number(figure(clip, name), digits)


def _busy_ms(end: str) -> Callable[[Cells], str]:
    return lambda clip: _number(sum(value or 0 for value in clip[f"{end}_ms"].values()), 1)


COLUMNS: dict[str, Callable[[Cells], str]] = {
    "clip": lambda clip: Path(clip["source"]).stem,
    "size": lambda clip: f"{clip['width']}x{clip['height']}, {clip['fps']:.3g}/s",
    "frames": _plain("frames", 0),
    "model packet, bytes": _plain("model_bytes", 0),
    "frame packets, bit/s": _plain("frame_bps", 0),
    "face PSNR, dB": _plain("face_psnr_db", 1),
    "5th percentile": _plain("face_psnr_p5_db", 1),
    "landmarks off, %": _plain("nme_percent", 1),
    "mouth / lids": lambda clip: " / ".join(
        _number(clip[name], 2) for name in ("mouth_corr", "blink_corr")
    ),
    "latency p50 / p99, ms": lambda clip: " / ".join(
        _number(figure(clip, f"latency_ms.{name}"), 0) for name in ("p50", "p99")
    ),
    "encoder, ms/frame": _busy_ms("encoder"),
    "decoder, ms/frame": _busy_ms("decoder"),
}
# Figures of the last row: means over the clips, a dash for the others.
MEAN_COLUMNS = {
    "model packet, bytes": "model_bytes",
    "frame packets, bit/s": "frame_bps",
    "face PSNR, dB": "face_psnr_db",
    "5th percentile": "face_psnr_p5_db",
    "landmarks off, %": "nme_percent",
}
MODELS_OF = {"thesis": "once", "default": "once", "live": "of models"}
OPTIONS = {
    "thesis": "--profile thesis",
    "default": "--profile default",
    "live": "--profile default --live --no-pace",
}
LATENCY = "latency p50 / p99, ms"
TIMES = (LATENCY, "encoder, ms/frame", "decoder, ms/frame")


def marks(way: str) -> tuple[str, str]:
    """The lines in docs/measurements.md around the figures of a way of coding."""
    return f"<!-- figures: {way} -->\n", f"<!-- end of figures: {way} -->\n"


def way_of(report: Mapping[str, Any]) -> str:
    """The profile, or "live" for the default profile sent live."""
    settings = report["settings"]
    return "live" if settings.get("live") else str(settings["profile"])


def markdown(report: Mapping[str, Any], times: bool = True) -> str:
    """A sentence and a table of the report of a bench."""
    clips, mean, way = report["clips"], report["mean"], way_of(report)
    # A call that looks ahead has no latency: the whole source has been read before it begins.
    hidden = TIMES if not times else () if way == "thesis" else (LATENCY,)
    columns = [title for title in COLUMNS if title not in hidden]
    rows = [[COLUMNS[title](clip) for title in columns] for clip in clips]
    rows.append(["**mean**", *(_mean_cell(mean, title, COLUMNS[title]) for title in columns[1:])])
    lines = [columns, ["---"] * len(columns), *rows]
    sources = " ".join(Path(clip["source"]).name for clip in clips)
    return (
        f"**{mean['frame_bps']:.0f} bit/s at {mean['face_psnr_db']:.1f} dB** over the face, mean of"
        f" {len(clips)} real clips, after {mean['model_bytes'] / 1000:.1f} kB {MODELS_OF[way]}"
        f" (`risorius bench {OPTIONS[way]} {sources}`):\n\n"
        + "".join(f"| {' | '.join(line)} |\n" for line in lines)
    )


def replaced(text: str, report: Mapping[str, Any], times: bool = True) -> str:
    """The text of docs/measurements.md with a report's figures between the marks of its profile.

    Raises `ValueError` if the marks are not there.
    """
    begin, end = marks(way_of(report))
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return before + begin + markdown(report, times) + end + after


def _mean_cell(mean: Mapping[str, Any], title: str, own: Callable[[Cells], str]) -> str:
    if title not in MEAN_COLUMNS:
        return own(mean) if title == "mouth / lids" else ""
    digits = 0 if title.startswith(("model", "frame")) else 1
    return _number(mean[MEAN_COLUMNS[title]], digits)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def main(arguments: Sequence[str]) -> None:
    """Rewrite docs/measurements.md from the reports named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("report", nargs="+", type=Path, help="report.json of a bench")
    parser.add_argument("--without-times", action="store_true", help="no latencies, no times")
    options: Any = parser.parse_args(arguments)
    text = MEASUREMENTS.read_text(encoding="utf-8")
    for path in options.report:
        report = json.loads(path.read_text(encoding="utf-8"))
        text = replaced(text, report, times=not options.without_times)
    MEASUREMENTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    run(main)
