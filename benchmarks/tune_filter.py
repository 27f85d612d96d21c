"""Tuning of the filter's Q and R (thesis 5.3.1): python -m benchmarks tune_filter CALL...

Renders the person of each call file (thesis profile) as `track_synthetic` does, tracks the video
with the standard deviations of the process noise (Q) and of all measurements (R) scaled by each
pair of factors, and prints RMS errors (eq. 5.1), means over the calls: of the angles, and of the
actuators of Fig. 5.7.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.command import run
from benchmarks.track_synthetic import (
    ANGLES,
    CONFIGURATIONS,
    POSE,
    errors,
    render_sequence,
    track_video,
    write_script,
)
from encoder.thesis.ekf import Estimate, FaceFilter, Measurements, ProcessNoise
from loopback.report import markdown_line, markdown_table
from shared_model.parameters import THESIS_EAUS

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
# What one filter is made by.
FILTER = "encoder.thesis.measurement_fusion.FaceFilter"


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("call", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/tuning"))
    parser.add_argument("--frames", type=int, default=225)
    parser.add_argument("--yaw", type=float, default=POSE["yaw"][0], metavar="DEGREES")
    parser.add_argument("--q", nargs="+", type=float, default=FACTORS, metavar="FACTOR")
    parser.add_argument("--r", nargs="+", type=float, default=FACTORS, metavar="FACTOR")
    parser.add_argument("--configuration", choices=list(CONFIGURATIONS), default="all parts")
    options = parser.parse_args(arguments)
    script = write_script(options.out, options.frames, options.yaw)
    sequences = [render_sequence(script, call, options.out) for call in options.call]
    names = [*ANGLES, *(name.replace("_", " ") for name in THESIS_EAUS), "lost %"]
    print(markdown_table(["Q", "R", *names], []))
    for q in options.q:
        for r in options.r:
            with tuned(q, r):
                found = [
                    errors(track_video(video, CONFIGURATIONS[options.configuration]), truth)
                    for video, truth in sequences
                ]
            print(markdown_line([f"{q:g}", f"{r:g}", *cells(found)]), flush=True)


@contextmanager
def tuned(q: float, r: float) -> Iterator[None]:
    """Filters that are made within have standard deviations scaled by q and r."""

    class TunedFilter(FaceFilter):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            given = [scaled(each, q) for each in arguments]
            super().__init__(*given, **{name: scaled(each, q) for name, each in named.items()})

        def update(self, measured: Measurements) -> Estimate:
            points, eau = r**2 * measured.variance_px2, r**2 * measured.eau_variance
            return super().update(replace(measured, variance_px2=points, eau_variance=eau))

    with patch(FILTER, TunedFilter):
        yield


def scaled(value: Any, factor: float) -> Any:
    """A process noise with its deviations scaled; anything else as it is."""
    if not isinstance(value, ProcessNoise):
        return value
    deviations = {f.name: getattr(value, f.name) for f in fields(value) if f.name != "velocities"}
    return replace(value, **{name: factor * each for name, each in deviations.items()})


def cells(found: Sequence[dict[str, Any]]) -> list[str]:
    """The cells of a line: means over the calls."""
    values = np.mean([each["rmse"] for each in found], axis=0)
    lost = 100 * float(np.mean([each["lost"] for each in found]))
    texts = [f"{v:.2f}" if i < len(ANGLES) else f"{v:.3f}" for i, v in enumerate(values)]
    return [*texts, f"{lost:.1f}"]


if __name__ == "__main__":
    run(main)
