"""`risorius bench --pose-truth` and `--labels`: what the tracker finds, against what is known."""

import argparse
from dataclasses import fields
from pathlib import Path

from encoder.option_rules import (
    DEFAULT_OPTIONS,
    THESIS_OPTIONS,
    Options,
    as_typed,
    check_model_is_named,
    reject,
)
from risorius.command_line.output_checks import check_output_folder
from risorius.command_line.progress import say, warn
from risorius.command_line.signals import StopOnSignal

# Options without an effect where clips are tracked and not sent, and their defaults.
NOT_FOR_TRACKS: Options = {
    **{
        name: default
        for name, default in THESIS_OPTIONS.items()
        if name not in ("aam", "aam_feedback")
    },
    **DEFAULT_OPTIONS,
    **dict.fromkeys(("profile", "preset", "sweep", "against", "scheduler", "model_bytes", "cores")),
    **{"timings": False, "jobs": 1, "pace": True, "busy": 0},
}


def run_tracks(arguments: argparse.Namespace) -> int:
    """`risorius bench --pose-truth`, `--labels`."""
    asked = "--pose-truth" if arguments.pose_truth else "--labels"
    reject(vars(arguments), NOT_FOR_TRACKS, asked)
    check_model_is_named(vars(arguments), as_typed)
    from aam.charts import NEEDED, has_charts
    from loopback.bench import ClipFailure, make_folder
    from loopback.report import table, write_json, write_report
    from risorius.track_bench.track_bench import (
        ClipTrack,
        TrackBenchOptions,
        bench_tracks,
        expression_rows,
        pose_chart,
        pose_rows,
        scores_of,
        track_report,
        unit_rows,
    )
    from risorius.track_files import csv_text

    given = {item.name: getattr(arguments, item.name) for item in fields(TrackBenchOptions)}
    folder, clips = arguments.out or Path("out/tracks"), list[ClipTrack]()
    failures = list[ClipFailure]()
    check_output_folder(folder)
    with StopOnSignal():
        for item in bench_tracks(arguments.source, TrackBenchOptions(**given), say):
            if isinstance(item, ClipFailure):
                failures.append(item)
                warn([f"{item.source} failed: {item.error}"])
                continue
            clips.append(item)
            make_folder(folder)
            write_report(folder / f"{item.name}.csv", csv_text(item.found.columns).encode())
            if item.poses is not None and has_charts():
                write_report(folder / f"{item.name}.svg", pose_chart(item).encode())
            write_json(folder / "report.json", track_report(clips, failures))
    tables = (pose_rows(clips), expression_rows(clips), unit_rows(scores_of(clips)))
    for head, rows in tables:
        if rows:
            print(f"{table(head, rows)}\n")
    if clips:
        say(f"bench: report.json and the tracks are in {folder}")
    if arguments.pose_truth and not has_charts():
        say(NEEDED)
    return failures[0].error.exit_code if failures else 0
