"""Synthetic pose and expression (thesis 5.3.1): python -m benchmarks track_synthetic CALL...

Renders the person of each call file (thesis profile) with moving pose and expression, tracks the
video with the whole tracker and with each part left out, and prints RMS errors (eq. 5.1) in
Markdown.  --aam MODEL adds the tracker whose landmarks are those of a statistical model, searched
in every frame.  --yaw: degrees to either side.  --out takes the sequences, figures.json and charts.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import run, warn
from encoder.capture.video_source import open_source
from encoder.thesis.trackers import TRACKED_EAUS, FaceTracker, open_tracker
from encoder.thesis.tracking_options import TrackingOptions
from loopback.report import markdown_table, write_report
from loopback.report_page import chart, environment, page, plotly_graphs
from risorius.animation.animate import animate
from risorius.statistical_model import expression_search, landmark_source
from shared_model.arrays import Array, Picture
from shared_model.geometry import euler_deg
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters

ANGLES = ("pitch", "yaw", "roll")
THESIS_RMSE = (3.395, 4.565, 2.552, 0.095, 0.122, 0.256, 0.105)
FPS, KEY_S = 25, 0.2
# Track -> (amplitude, period in s).  Periods have no common multiple within the sequence, so that
# extremes meet in many ways.
POSE = {"yaw": (45.0, 6.1), "pitch": (25.0, 4.7), "roll": (30.0, 7.3)}
EAUS = {
    "jaw_drop": (0.8, 1.7),
    "mouth_corners": (0.8, 2.3),
    "eyebrow_middle": (0.8, 3.1),
    "eyebrow_inner": (0.8, 2.7),
}
LIGHT = {"brightness": (0.15, 5.0), "side": (0.4, 8.3)}

CONFIGURATIONS: Mapping[str, TrackingOptions] = {
    "all parts": TrackingOptions(tracker="full"),
    "without EKF": TrackingOptions(tracker="full", without=frozenset({"ekf"})),
    "without ABS": TrackingOptions(tracker="full", without=frozenset({"abs"})),
    "without KLT": TrackingOptions(tracker="full", without=frozenset({"klt"})),
    "identity of the first frame": TrackingOptions(refine_identity=False),
    "without network after frame 1": TrackingOptions(
        tracker="full", without=frozenset({"network"})
    ),
    "no network at all (Viola-Jones)": TrackingOptions("haar", "full"),
    "KLT points wherever visible": TrackingOptions(klt_points="visible"),
    "retinex": TrackingOptions(normalise="retinex"),
    "visible half mirrored": TrackingOptions(step="mirrored"),
    "prediction matrix": TrackingOptions(step="matrix"),
    "focal length in the state": TrackingOptions(free_focal=True),
    "Lowe's projection": TrackingOptions(projection="lowe"),
    "both": TrackingOptions(projection="lowe", free_focal=True),
    "network alone, each frame": TrackingOptions(tracker="single"),
}


@dataclass(frozen=True, slots=True)
class TrackedValues:
    """(t, 7) tracked angles and EAUs, nan where the face was lost; the fitted focal length."""

    values: Array
    focal_px: float


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("call", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/tracking"))
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--yaw", type=float, default=POSE["yaw"][0], metavar="DEGREES")
    parser.add_argument("--only", nargs="*", default=list(CONFIGURATIONS), metavar="CONFIGURATION")
    parser.add_argument("--aam", metavar="MODEL")
    options = parser.parse_args(arguments)
    script = write_script(options.out, options.frames, options.yaw)
    figures: dict[str, dict[str, Any]] = {}
    for call in options.call:
        video, truth = render_sequence(script, call, options.out)
        chosen = {name: CONFIGURATIONS[name] for name in options.only}
        chosen |= configurations_with_model(options.aam)
        found = {name: track_video(video, each) for name, each in chosen.items()}
        figures[call.stem] = {name: errors(f, truth) for name, f in found.items()}
        write_charts(options.out / call.stem, truth, found)
        (options.out / "figures.json").write_text(json.dumps(figures, indent=1))
    print(error_table(figures))


def configurations_with_model(model: str | None) -> dict[str, TrackingOptions]:
    """Trackers by a statistical model, with nothing of an earlier video; none without a model."""
    if model is None:
        return {}
    source, searched = landmark_source(model), landmark_source(model, every_frame=True)
    again = landmark_source(model, every_frame=True)

    def fed_back(without: Sequence[str] = ()) -> TrackingOptions:
        first, search = landmark_source(model), expression_search(model)
        return TrackingOptions(
            landmarks=first, expression_search=search, without=frozenset(without)
        )

    return {
        "statistical model in the first frame": TrackingOptions(landmarks=source),
        "statistical model in every frame": TrackingOptions(landmarks=searched),
        "the same and prediction matrix": TrackingOptions(landmarks=again, step="matrix"),
        "actuators by c in the filter": fed_back(),
        "the same without ABS": fed_back(["abs"]),
        "network, and actuators by c in the filter": TrackingOptions(
            expression_search=expression_search(model)
        ),
    }


def write_script(out: Path, frames: int, yaw_deg: float) -> Path:
    """The script of so many frames in a folder, as old as it is where it says the same."""
    out.mkdir(parents=True, exist_ok=True)
    script, text = out / "calibration.toml", calibration_script(frames / FPS, yaw_deg)
    if not script.exists() or script.read_text() != text:
        script.write_text(text)
    return script


def calibration_script(seconds: float, yaw_deg: float = POSE["yaw"][0]) -> str:
    """An animation script (docs/animate.md) whose tracks are sinusoids, neutral at time 0.

    yaw_deg: how far the head turns to either side.
    """
    pose = POSE | {"yaw": (yaw_deg, POSE["yaw"][1])}
    lines = [f"seconds = {seconds}", f"fps = {FPS}", "noise = 2.0"]
    for time_s in np.arange(0, seconds, KEY_S):

        def swing(tracks: Mapping[str, tuple[float, float]], about: Mapping[str, float]) -> str:
            values = {
                name: about.get(name, 0.0) + a * np.sin(2 * np.pi * time_s / period)  # noqa: B023
                for name, (a, period) in tracks.items()
            }
            # A jaw only opens: it swings from shut to its amplitude.
            if "jaw_drop" in tracks:
                a, period = tracks["jaw_drop"]
                values["jaw_drop"] = a * np.sin(np.pi * time_s / period) ** 2  # noqa: B023
            return ", ".join(f"{name} = {value:.4f}" for name, value in values.items())

        lines += [
            "[[key]]",
            f"time = {time_s:.3f}",
            f"pose = {{ {swing(pose, {})} }}",
            f"eau = {{ {swing(EAUS, {})} }}",
            f"light = {{ {swing(LIGHT, {'brightness': 1.0})} }}",
        ]
    return "\n".join(lines) + "\n"


def render_sequence(script: Path, call: Path, out: Path) -> tuple[Path, dict[str, Any]]:
    """The sequence of one call, rendered unless it is newer than its script, and its truth."""
    video = out / f"{call.stem}.mkv"
    if not video.exists() or video.stat().st_mtime_ns < script.stat().st_mtime_ns:
        animate(script, video, lambda *_: None, lambda: False, call)
    return video, json.loads(video.with_suffix(".json").read_text())


def track_video(video: Path, options: TrackingOptions) -> TrackedValues:
    """Track a video from its first frame."""
    with open_source(str(video)) as capture:
        size, elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
        tracker = open_tracker(options, generic_head(), size, TRACKED_EAUS, elapsed_s, warn)
        values = [_values(track_frame(tracker, frame)) for _, frame in capture]
    try:
        focal_px = tracker.fitted.camera.focal_px
    except ValueError:
        focal_px = float("nan")
    return TrackedValues(np.array(values), focal_px)


def track_frame(tracker: FaceTracker, frame: Picture) -> FaceParameters | None:
    """The face in the next frame; adopts a refined identity when one is ready."""
    face = tracker.update(frame)
    refined = tracker.take_refined_identity()
    if refined is not None:
        tracker.adopt(refined)
    return face


def _values(face: FaceParameters | None) -> Array:
    if face is None:
        return np.full(len(ANGLES) + len(THESIS_EAUS), np.nan)
    return np.array([*euler_deg(face.pose), *(face.eau[EAU_INDEX[n]] for n in THESIS_EAUS)])


def ground_truth_values(truth: Mapping[str, Any]) -> Array:
    """(t, 7) angles in degrees and EAUs."""
    at = [truth["eaus"].index(name) for name in THESIS_EAUS]
    rows = [[*f["pitch_yaw_roll_deg"], *np.array(f["eau"])[at]] for f in truth["frames"]]
    return np.asarray(rows, np.float64)


def errors(tracked: TrackedValues, truth: Mapping[str, Any]) -> dict[str, Any]:
    """RMS errors, their standard deviation, the share of lost frames and the focal length's error.

    The definition of a neutral face differs by a constant between models; the standard deviation
    does not contain it.
    """
    truth_values = ground_truth_values(truth)
    error = tracked.values[: len(truth_values)] - truth_values[: len(tracked.values)]
    error[:, :3] = (error[:, :3] + 180) % 360 - 180
    focal = truth["frames"][0]["focal_px"]
    return {
        "rmse": np.sqrt(np.nanmean(error**2, axis=0)).tolist(),
        "about_mean": np.nanstd(error, axis=0).tolist(),
        "lost": float(np.isnan(error[:, 0]).mean()),
        "focal_percent": 100 * (tracked.focal_px / focal - 1),
    }


def error_table(figures: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """A table of the errors of each configuration and call, their mean, and the thesis' errors."""
    names = [*ANGLES, *(name.replace("_", " ") for name in THESIS_EAUS), "lost %", "focal %"]
    lines = [["thesis", "", *_cells(THESIS_RMSE), "", ""]]
    for name in next(iter(figures.values())):
        rows = {caller: of[name] for caller, of in figures.items()}
        for caller, row in rows.items():
            more = f"{100 * row['lost']:.1f}", f"{row['focal_percent']:+.1f}"
            lines.append([name, caller, *_cells(row["rmse"]), *more])
        for what, key in (("mean", "rmse"), ("mean, less offset", "about_mean")):
            mean = np.mean([row[key] for row in rows.values()], axis=0)
            lines.append([name, what, *_cells(mean), "", ""])
    return markdown_table(["", "caller", *names], lines)


def _cells(row: Sequence[float]) -> list[str]:
    return [f"{v:.2f}" if i < 3 else f"{v:.3f}" for i, v in enumerate(row)]


def write_charts(stem: Path, truth: Mapping[str, Any], found: Mapping[str, TrackedValues]) -> None:
    """A page with charts as Fig. 5.6 (angles) and Fig. 5.7 (EAUs), of the first configuration."""
    graphs = plotly_graphs()
    from plotly.subplots import make_subplots

    name, first = next(iter(found.items()))
    expected, time_s = ground_truth_values(truth), [f["time_s"] for f in truth["frames"]]
    titles = [*(f"{a}, degrees" for a in ANGLES), *(n.replace("_", " ") for n in THESIS_EAUS)]
    figure = make_subplots(len(titles), 1, shared_xaxes=True, subplot_titles=titles)
    for row in range(len(titles)):
        for label, values, colour in (("true", expected, "#bbb"), (name, first.values, "#1a5ab4")):
            line = graphs.Scatter(x=time_s, y=values[:, row], name=label, line_color=colour)
            figure.add_trace(line.update(showlegend=row == 0), row + 1, 1)
    figure.update_layout(height=170 * len(titles))
    write_report(stem.with_suffix(".html"), page(stem.name, [chart(figure), environment()]))


if __name__ == "__main__":
    run(main)
