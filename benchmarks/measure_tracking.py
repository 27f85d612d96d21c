"""Milliseconds a frame and jitter of each tracker: python -m benchmarks measure_tracking CLIP...

For every configuration of the synthetic experiment: median milliseconds a frame, the RMS second
difference of pitch, yaw and roll (degrees), and frames lost; then the mean milliseconds of each
part of every tracker.  Times are CPU times of one core.
"""

import argparse
import functools
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.command import run, warn
from benchmarks.track_synthetic import CONFIGURATIONS, track_frame
from encoder.capture.video_source import open_source
from encoder.thesis.detection_measurement import LandmarkMeasurer
from encoder.thesis.ekf import FaceFilter
from encoder.thesis.klt import KltTracker
from encoder.thesis.person_texture import PersonTexture
from encoder.thesis.trackers import TRACKED_EAUS, TrackingOptions, open_tracker
from shared_model.arrays import Array
from shared_model.geometry import euler_deg
from shared_model.mesh import generic_head

Methods = tuple[tuple[type, Callable[..., Any]], ...]

PARTS: dict[str, Methods] = {
    "landmarks and their fit": ((LandmarkMeasurer, LandmarkMeasurer.measure),),
    "KLT": ((KltTracker, KltTracker.track), (KltTracker, KltTracker.reset_points)),
    "EKF": ((FaceFilter, FaceFilter.predict), (FaceFilter, FaceFilter.update)),
    "ABS": (
        (PersonTexture, PersonTexture.observe),
        (PersonTexture, PersonTexture.fit),
        (PersonTexture, PersonTexture.update_template),
    ),
}


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", nargs="+")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--only", nargs="+", default=list(CONFIGURATIONS), metavar="CONFIGURATION")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    times_ms = time_methods(PARTS)
    print("| clip | tracker | ms | jitter pitch yaw roll | lost |\n|---|---|---|---|---|")
    parts: list[str] = []
    for source in options.source:
        for name in options.only:
            times_ms.clear()
            label = f"| {Path(source).name} | {name} |"
            print(
                f"{label} {table_cells(source, CONFIGURATIONS[name], options.frames)} |", flush=True
            )
            # Some parts run more than once in a frame.
            ms = (sum(times_ms[part]) / options.frames for part in PARTS)
            parts.append(f"{label} {' | '.join(f'{value:.1f}' for value in ms)} |")
    print("\n| clip | tracker | " + " | ".join(PARTS) + " |\n" + "|---" * (len(PARTS) + 2) + "|")
    print("\n".join(parts))


def table_cells(source: str, options: TrackingOptions, count: int) -> str:
    """The cells of one clip and tracker."""
    times_ms, angles = [], []
    with open_source(source) as capture:
        size, elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
        tracker = open_tracker(options, generic_head(), size, TRACKED_EAUS, elapsed_s, warn)
        for _, frame in islice(capture, count):
            start = time.process_time()
            face = track_frame(tracker, frame)
            times_ms.append(1000 * (time.process_time() - start))
            angles.append((np.nan,) * 3 if face is None else euler_deg(face.pose))
    jitter_cells = " ".join(f"{value:.2f}" for value in jitter(np.array(angles)))
    return f"{np.median(times_ms):.1f} | {jitter_cells} | {int(np.isnan(angles).any(1).sum())}"


def jitter(angles: Array) -> Array:
    """(3,) RMS second difference of angles (t, 3) over time."""
    return np.asarray(np.sqrt(np.nanmean(np.diff(angles, 2, axis=0) ** 2, axis=0)))


def time_methods(
    parts: dict[str, Methods],
) -> dict[str, list[float]]:
    """Replace methods by ones that append their duration, ms, to the list of their part."""
    times_ms: dict[str, list[float]] = defaultdict(list)
    for name, methods in parts.items():
        for owner, method in methods:
            setattr(owner, method.__name__, _timed(method, times_ms, name))
    return times_ms


def _timed(
    call: Callable[..., Any], times_ms: dict[str, list[float]], name: str
) -> Callable[..., Any]:
    @functools.wraps(call)
    def timed(*arguments: Any) -> Any:
        start = time.process_time()
        try:
            return call(*arguments)
        finally:
            times_ms[name].append(1000 * (time.process_time() - start))

    return timed


if __name__ == "__main__":
    run(main)
