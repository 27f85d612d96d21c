"""Actuators with and without the Kalman filter (Fig. 5.9): python -m benchmarks ekf_effect CLIP...

Tracks each clip with the whole tracker and with the filter left out, and prints of each actuator
what Figures 5.9 and 5.13 state of them, and the root mean square of their second differences, which
tells how restless they are.  --out takes NAME.svg for each clip (with matplotlib).
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from aam.charts import NEEDED, Line, Panel, chart_svg, has_charts
from benchmarks.command import run, warn
from encoder.thesis.tracking_options import TRACKER_PARTS
from loopback.report import markdown_line, markdown_table, write_report
from risorius.face_track import FaceTrack, track
from shared_model.arrays import Array
from shared_model.parameters import EAU_INDEX, THESIS_EAUS

EKF = "ekf"
LABELS = ("without EKF", "with EKF")

HEADER = ("clip", "EAU", "", "N", "min", "max", "mean", "sd", "restlessness")


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", nargs="+")
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--frames", type=int, metavar="N")
    parser.add_argument("--eaus", nargs="+", choices=list(EAU_INDEX), default=list(THESIS_EAUS))
    parser.add_argument(
        "--without",
        nargs="*",
        choices=[part for part in TRACKER_PARTS if part != EKF],
        default=[],
        help="parts of the tracker that are left out of both",
    )
    options = parser.parse_args(arguments)
    print(markdown_table(HEADER, []))
    for source in options.source:
        tracks = {
            label: track(source, options.frames, without=[*options.without, *left_out])
            for label, left_out in zip(LABELS, ((EKF,), ()), strict=True)
        }
        print("\n".join(table_rows(Path(source).name, tracks, options.eaus)), flush=True)
        if options.out is not None and has_charts():
            options.out.mkdir(parents=True, exist_ok=True)
            text = figure(tracks, options.eaus)
            write_report(options.out / f"{Path(source).stem}.svg", text.encode())
    if options.out is not None and not has_charts():
        warn(NEEDED)


def table_rows(name: str, tracks: Mapping[str, FaceTrack], eaus: Sequence[str]) -> list[str]:
    """A line for each actuator and track: the descriptive statistics of Fig. 5.9."""
    lines = []
    for eau in eaus:
        for label, found in tracks.items():
            values = found.eau[:, EAU_INDEX[eau]]
            there = values[np.isfinite(values)]
            numbers = (there.min(), there.max(), there.mean(), there.std(), restlessness(values))
            cells = [f"{number:.3f}" for number in numbers]
            lines.append(markdown_line([name, eau, label, len(there), *cells]))
    return lines


def restlessness(values: Array) -> float:
    """Root mean square second difference over time of values (t,), nan without a face."""
    return float(np.sqrt(np.nanmean(np.diff(values, 2) ** 2)))


def figure(tracks: Mapping[str, FaceTrack], eaus: Sequence[str]) -> str:
    """An SVG with a panel for each actuator."""
    panels = [
        Panel(
            eau.replace("_", " "),
            "s",
            "",
            [
                Line(label, found.time_s, found.eau[:, EAU_INDEX[eau]])
                for label, found in tracks.items()
            ],
        )
        for eau in eaus
    ]
    return chart_svg(panels, columns=min(len(panels), 2))


if __name__ == "__main__":
    run(main)
