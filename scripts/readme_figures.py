"""Puts the figures of a bench into README.md, between its two marks.

usage: risorius bench CLIP... --out DIR && python scripts/readme_figures.py DIR/report.json
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from loopback.report import figure

README = Path(__file__).resolve().parent.parent / "README.md"
BEGIN, END = "<!-- figures -->\n", "<!-- end of figures -->\n"
COLUMNS = {
    "clip": "source",
    "size": None,
    "frames": "frames",
    "model packet, bytes": "model_bytes",
    "frame packets, bit/s": "frame_bps",
    "face PSNR, dB": "face_psnr_db",
    "5th percentile": "face_psnr_p5_db",
    "latency p50 / p99, ms": None,
    "encoder, frames/s": "encoder_fps",
}


def markdown(report: Mapping[str, Any]) -> str:
    """A sentence and a table of the report of a bench."""
    clips, mean = report["clips"], report["mean"]
    rows = [
        "| " + " | ".join(COLUMNS) + " |",
        "|---" * len(COLUMNS) + "|",
        *("| " + " | ".join(_cells(clip)) + " |" for clip in clips),
    ]
    sources = " ".join(clip["source"] for clip in clips)
    return (
        f"**{mean['frame_bps']:g} bit/s at {mean['face_psnr_db']:.1f} dB** over the face, mean of"
        f" {len(clips)} real clips, after {mean['model_bytes'] / 1000:.1f} kB once"
        f" (`risorius bench {sources}`):\n\n" + "\n".join(rows) + "\n"
    )


def _cells(clip: Mapping[str, Any]) -> list[str]:
    special = {
        "size": f"{clip['width']}x{clip['height']}, {clip['fps']:g}/s",
        "latency p50 / p99, ms": " / ".join(
            f"{figure(clip, f'latency_ms.{name}'):.0f}" for name in ("p50", "p99")
        ),
    }
    return [special[title] if name is None else str(clip[name]) for title, name in COLUMNS.items()]


def main(arguments: list[str]) -> None:
    """Rewrite README.md from the report named on the command line."""
    report = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    _, after = rest.split(END)
    README.write_text(before + BEGIN + markdown(report) + END + after, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
