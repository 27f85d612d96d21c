"""`risorius bench --pose-truth` and `--labels`: the tracker alone, against what is known."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aam.charts import Line, Panel, chart_svg
from loopback.bench import ClipFailure, check_recorded, output_names
from loopback.quality.emotion_agreement import shown_emotions
from loopback.report import Cell, rounded
from risorius.face_track import FaceTrack, track
from risorius.track_bench.pose_errors import ANGLES, PoseComparison, compare_poses
from risorius.track_bench.pose_truth import find_pose_truth
from risorius.track_bench.unit_labels import UnitLabels, find_unit_labels
from risorius.track_bench.unit_scores import UnitScore, unit_scores
from shared_model.arrays import Array
from shared_model.errors import UserError
from shared_model.parameters import EAU_INDEX, EAUS, THESIS_EAUS

# Of report.json: raised where a figure changes its name or meaning.
SCHEMA = "risorius-track-bench/1"


@dataclass(frozen=True, slots=True)
class TrackBenchOptions:
    """pose_truth, labels: files or folders of them; None: not asked for.

    aam, aam_feedback: see `track`.
    """

    pose_truth: Path | None = None
    labels: Path | None = None
    aam: str | None = None
    aam_feedback: bool = False
    max_frames: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ExpressionComparison:
    """found, truth: (t, len(EAUS)) actuators; nan in `found` without a face."""

    found: Array
    truth: Array

    @property
    def rms(self) -> Array:
        """(len(EAUS),) root mean square errors (eq. 5.1)."""
        return np.asarray(np.sqrt(np.nanmean((self.found - self.truth) ** 2, axis=0)))

    @property
    def same_emotion(self) -> float:
        """Share of the frames with a face that show the true emotion, or none as the truth does."""
        there = np.isfinite(self.found[:, 0])
        found, truth = (shown_emotions(each[there]) for each in (self.found, self.truth))
        return float((found == truth).mean())


@dataclass(frozen=True, slots=True, eq=False)
class ClipTrack:
    """A tracked source beside what is known of it; None: not asked for.

    name: of its files, see `output_names`.
    """

    source: str
    name: str
    found: FaceTrack
    poses: PoseComparison | None
    expressions: ExpressionComparison | None
    labels: UnitLabels | None


def bench_tracks(
    sources: Sequence[str], options: TrackBenchOptions, say: Callable[[str], None]
) -> Iterator[ClipTrack | ClipFailure]:
    """Track each source, or say why it cannot be, one after the other.

    Raises `UserError` before anything runs if a source cannot be read, or if one file is named
    for several sources.
    """
    check_recorded(sources)
    for place in (options.pose_truth, options.labels):
        if place is not None and not place.exists():
            raise UserError(f"{place}: no such file or folder")
        if place is not None and place.is_file() and len(sources) > 1:
            raise UserError(
                f"{place} is of one recording; name a folder for {len(sources)} sources"
            )
    for source, name in zip(sources, output_names(sources), strict=True):
        say(f"bench: {source}")
        try:
            yield _tracked(source, name, options)
        except UserError as error:
            yield ClipFailure(source, error)


def _tracked(source: str, name: str, options: TrackBenchOptions) -> ClipTrack:
    truth = None if options.pose_truth is None else find_pose_truth(options.pose_truth, source)
    labels = None if options.labels is None else find_unit_labels(options.labels, source)
    found = track(source, options.max_frames, aam=options.aam, aam_feedback=options.aam_feedback)
    if truth is None:
        return ClipTrack(source, name, found, None, None, labels)
    try:
        poses = compare_poses(found.pose[:, :3], truth.rotation)
    except ValueError as error:
        raise UserError(f"{source}: no face in the frames whose pose is known") from error
    expressions = None if truth.eau is None else compare_expressions(found.eau, truth.eau)
    return ClipTrack(source, name, found, poses, expressions, labels)


def scores_of(clips: Sequence[ClipTrack]) -> dict[str, UnitScore]:
    """The scores of the units over all clips with labels."""
    return unit_scores([(c.found.action_units, c.labels) for c in clips if c.labels is not None])


def track_report(clips: Sequence[ClipTrack], failures: Sequence[ClipFailure]) -> dict[str, Any]:
    """What report.json says: the figures of each clip, of each unit, and `failed`."""
    return {
        "schema": SCHEMA,
        "clips": [{"source": c.source, **_figures(c)} for c in clips],
        "units": {name: asdict(score) for name, score in scores_of(clips).items()},
        "failed": [{"source": f.source, "error": str(f.error)} for f in failures],
    }


def pose_rows(clips: Sequence[ClipTrack]) -> tuple[list[str], list[list[Cell]]]:
    """The table of poses: head and rows; the last one is of all frames."""
    measured = [(Path(c.source).name, c.poses) for c in clips if c.poses is not None]
    if len(measured) > 1:
        parts = [poses for _, poses in measured]
        stacked = (np.concatenate([getattr(p, n) for p in parts]) for n in ("found", "truth"))
        measured.append(("all", PoseComparison(*stacked)))
    head = ["clip", "frames", "found %"]
    head += [f"{kind} {angle}" for kind in ("mean", "rms") for angle in ANGLES]
    rows: list[list[Cell]] = []
    for name, p in measured:
        errors = [rounded(float(v)) for each in (p.mean_deg, p.rms_deg) for v in each]
        rows.append([name, len(p.found), rounded(100 * p.found_share, 1), *errors])
    return head, rows


def expression_rows(clips: Sequence[ClipTrack]) -> tuple[list[str], list[list[Cell]]]:
    """The table of actuators of animations: head and rows."""
    head = ["clip", *(f"rms {name}" for name in THESIS_EAUS), "same emotion %"]
    rows: list[list[Cell]] = []
    for clip in clips:
        if clip.expressions is not None:
            errors = [rounded(float(clip.expressions.rms[EAU_INDEX[n]]), 3) for n in THESIS_EAUS]
            same = rounded(100 * clip.expressions.same_emotion, 1)
            rows.append([Path(clip.source).name, *errors, same])
    return head, rows


def unit_rows(scores: dict[str, UnitScore]) -> tuple[list[str], list[list[Cell]]]:
    """The table of action units: head and rows, and the mean of those that some frame shows."""
    head = ["unit", "frames", "shown", "recall", "precision", "F1", "AUC"]
    rows: list[list[Cell]] = []
    for name, score in scores.items():
        if score.shown:
            shares = (score.recall, score.precision, score.f1, score.auc)
            rows.append([name, score.judged, score.shown, *(rounded(each) for each in shares)])
    if len(rows) > 1:
        f1 = float(np.mean([s.f1 for s in scores.values() if s.shown]))
        areas = [s.auc for s in scores.values() if s.auc is not None]
        area = rounded(float(np.mean(areas))) if areas else None
        rows.append(["mean", None, None, None, None, rounded(f1), area])
    return head, rows


def pose_chart(clip: ClipTrack) -> str:
    """An SVG of true and tracked angles over time (Fig. 5.12).  Raises `UserError`, `chart_svg`."""
    assert clip.poses is not None
    time_s = clip.found.time_s[: len(clip.poses.found)]
    panels = [
        Panel(
            angle,
            "s",
            "degrees",
            [
                Line("measured", time_s, clip.poses.truth[:, axis], "--"),
                Line("tracked", time_s, clip.poses.found[:, axis]),
            ],
        )
        for axis, angle in enumerate(ANGLES)
    ]
    return chart_svg(panels)


def _figures(clip: ClipTrack) -> dict[str, Any]:
    poses, expressions = clip.poses, clip.expressions
    if poses is None:
        return {}
    figures: dict[str, Any] = {"frames": len(poses.found), "found": rounded(poses.found_share, 4)}
    for kind, values in (("mean", poses.mean_deg), ("rms", poses.rms_deg)):
        figures |= {
            f"{angle}_{kind}_deg": rounded(float(v), 3)
            for angle, v in zip(ANGLES, values, strict=True)
        }
    if expressions is not None:
        pairs = zip(EAUS, expressions.rms, strict=True)
        figures["eau_rms"] = {eau.name: rounded(float(v), 4) for eau, v in pairs}
        figures["same_emotion"] = rounded(expressions.same_emotion, 4)
    return figures


def compare_expressions(found: Array, truth: Array) -> ExpressionComparison:
    """Compare the frames that both have."""
    count = min(len(found), len(truth))
    return ExpressionComparison(found[:count], truth[:count])
