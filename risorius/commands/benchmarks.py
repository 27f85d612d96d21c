"""`risorius bench` and `risorius replay`: recorded videos, measured."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from encoder.option_rules import (
    DEFAULT_OPTIONS,
    THESIS_OPTIONS,
    Options,
    as_typed,
    checked_options,
    reject,
)
from risorius.command_line.argument_types import names, rungs
from risorius.command_line.options import add_coding
from risorius.command_line.output_checks import check_output_folder, check_outputs
from risorius.command_line.parser import add_command
from risorius.command_line.progress import say, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

# Options without an effect in a sweep, and their defaults.
NOT_FOR_SWEEP: Options = {
    **THESIS_OPTIONS,
    **{name: default for name, default in DEFAULT_OPTIONS.items() if name != "live"},
    **{"model_bytes": None, "pace": True, "busy": 0, "cores": None},
}


def add_bench(added: "Commands") -> None:
    """`risorius bench`."""
    parser = add_command(
        added,
        "bench",
        "measure bits, PSNR and latency of recorded videos",
        "Encoder and decoder run as two processes that talk over Zenoh on this host.  Latency is\n"
        "from the reading of a frame to its picture; in the default profile, unless it is --live,\n"
        "both passes over the file are in between.\n"
        "With --sweep each clip is coded at several rates into call files; with --against other\n"
        "codecs code the same frames, and the report says what they need for our quality.\n"
        "With --pose-truth or --labels there is no call: each clip is tracked, and what was found\n"
        "is compared with measured poses (BU, BIWI, `risorius animate`) or with action units that\n"
        "people have coded (DISFA, CK+, MMI, tables as OpenFace writes them); docs/tracker.md.",
        "  risorius bench me.mp4 you.mp4 --out out/bench\n"
        "  risorius bench --timings --no-pace me.mp4\n"
        "  risorius bench --sweep 300,800,2000:20000 me.mp4 --out out/curves\n"
        "  risorius bench --against svtav1,x265,vp9 --max-frames 150 me.mp4\n"
        "  risorius bench bu/*.avi --pose-truth bu\n"
        "  risorius bench disfa/*.avi --labels disfa/ActionUnit_Labels\n",
    )
    parser.add_argument(
        "source",
        nargs="+",
        metavar="SOURCE",
        help="video file or image pattern, a folder of videos, or package:PACKAGE/PATH",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="decoded videos, report.json and report.html go here (default: out/bench, of a"
        " sweep out/curves, of tracks out/tracks)",
    )
    add_coding(parser)
    _add_measuring(parser)
    parser.set_defaults(run=run_bench)


def _add_measuring(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--sweep",
        type=rungs,
        metavar="BPS[:MODEL],...",
        help="draw the default profile's quality over these rates, each with a model of so many"
        " bytes; goes on where it was stopped (default with --against: 300 bit/s to 30 kbit/s)",
    )
    parser.add_argument(
        "--against",
        type=names,
        metavar="CODEC,...",
        help="other codecs on the same frames: svtav1, x265, x264, vp9, vvc; in real time with"
        " --live",
    )
    parser.add_argument(
        "--pose-truth",
        type=Path,
        metavar="PATH",
        help="compare the tracked pose with measured ones: a folder of files named as the clips,"
        " NAME.dat (BU), NAME/frame_%%05d_pose.txt (BIWI), NAME.json (animate), or a file",
    )
    parser.add_argument(
        "--labels",
        type=Path,
        metavar="PATH",
        help="F1 and area under the curve of each action unit: a folder of labels named as the"
        " clips, NAME_au12.txt (DISFA), NAME_00000011_facs.txt (CK+), NAME-oao_aucs.xml (MMI),"
        " NAME.csv with columns AU12_c or AU12_r, or a file",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        choices=range(1, 257),
        default=1,
        metavar="N",
        help="of a sweep: measure N clips at a time on this host",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a sweep: on a cluster, tcp://HOST:8786 of dask.distributed; it shares --out",
    )
    parser.add_argument(
        "--timings",
        action="store_true",
        help="also print where the time of both ends goes: ms a frame of each stage",
    )
    parser.add_argument(
        "--busy",
        type=int,
        choices=range(17),
        default=0,
        metavar="N",
        help="run N busy loops of normal priority beside, as a computer that does other things",
    )
    parser.add_argument(
        "--cores",
        metavar="LIST",
        help="run both ends, and what runs beside, on these cores alone: 0, or 0,1 (default: all)",
    )
    parser.add_argument(
        "--pace",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="send at the source's own rate; without it latencies mean nothing (default: yes)",
    )


def add_replay(added: "Commands") -> None:
    """`risorius replay`."""
    parser = add_command(
        added,
        "replay",
        "bench a suite of clips and fail on a missed threshold",
        "The suite is a TOML file: clips with sha256, settings and min/max of any report figure;\n"
        "docs/replay.md describes it.",
        "  risorius replay suite.toml --junit out/junit.xml\n"
        "  risorius replay suite.toml --baseline baseline.json --update-baseline\n"
        "  risorius replay suite.toml --baseline baseline.json\n",
    )
    parser.add_argument("suite", type=Path, metavar="SUITE", help="suite of clips (.toml)")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/replay"),
        metavar="DIR",
        help="decoded videos and report.json go here (default: %(default)s)",
    )
    parser.add_argument(
        "--baseline",
        type=Path,
        metavar="FILE",
        help="figures of before (.json): one that is worse by more than its tolerance is missed",
    )
    parser.add_argument(
        "--update-baseline",
        action="store_true",
        help="write today's figures into it instead, and print what has changed",
    )
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    parser.set_defaults(run=run_replay)


def run_bench(arguments: argparse.Namespace) -> int:
    """`risorius bench`."""
    from loopback.clip_paths import PREFIX, clip_path, videos_in

    arguments.source = [
        clip
        for each in arguments.source
        for clip in ([str(clip_path(each, Path()))] if each.startswith(PREFIX) else videos_in(each))
    ]
    if arguments.pose_truth or arguments.labels:
        from risorius.commands.bench_tracks import run_tracks

        return run_tracks(arguments)
    if arguments.sweep or arguments.against:
        return run_curves(arguments)
    options = checked_options(vars(arguments), as_typed)
    from loopback.bench import (
        BenchSettings,
        ClipFailure,
        bench,
        bench_page,
        bench_report,
        bench_table,
        encoder_options,
    )
    from loopback.report import write_json, write_report
    from loopback.timing_tables import timings_tables

    settings = BenchSettings(encoder_options(options), arguments.busy, arguments.cores)
    folder, clips = arguments.out or Path("out/bench"), list[dict[str, Any]]()
    failures = list[ClipFailure]()
    check_output_folder(folder)
    with StopOnSignal():
        try:
            for item in bench(arguments.source, settings, folder, say):
                if isinstance(item, ClipFailure):
                    failures.append(item)
                    warn([f"{item.source} failed: {item.error}"])
                else:
                    clips.append(item)
        finally:
            # Also after an interrupt, the clips that were measured are reported.
            if clips:
                write_json(folder / "report.json", bench_report(settings, clips, failures))
                write_report(folder / "report.html", bench_page(clips))
                print(bench_table(clips))
                if arguments.timings:
                    print(f"\n{timings_tables(clips)}")
                say(f"bench: report.json, report.html and the decoded videos are in {folder}")
    return failures[0].error.exit_code if failures else 0


def run_curves(arguments: argparse.Namespace) -> int:
    """`risorius bench --sweep`, `--against`."""
    if arguments.timings:
        raise UserError("--timings is about calls between two processes; leave out --sweep")
    if arguments.profile == "thesis":
        raise UserError("--sweep is about the default profile; leave out --profile thesis")
    reject(vars(arguments), NOT_FOR_SWEEP, "--sweep")
    from loopback.curves.contenders import LADDER, Rung
    from loopback.curves.curve_bench import (
        CurveSettings,
        bench_curves,
        curve_report,
        duel_rows,
        duels,
        open_pool,
        point_rows,
        read_exhibits,
        shown_rung,
    )
    from loopback.curves.curve_page import FIRST_SHOWN_S, curve_page
    from loopback.report import table, write_json, write_report
    from loopback.report_page import plotly_graphs

    plotly_graphs()
    chosen = tuple(Rung(*each) for each in arguments.sweep) if arguments.sweep else LADDER
    rivals = arguments.against or ()
    settings = CurveSettings(chosen, rivals, arguments.live, arguments.max_frames)
    folder = arguments.out or Path("out/curves")
    check_output_folder(folder)
    with StopOnSignal(), open_pool(arguments.jobs, arguments.scheduler) as pool:
        clips, judge, failures = bench_curves(arguments.source, settings, folder, say, pool)
    if clips:
        found = duels(clips, shown_rung(chosen).label)
        write_json(folder / "report.json", curve_report(clips, settings, failures))
        exhibits = {name: read_exhibits(folder, name) for name in clips}
        write_report(folder / "report.html", curve_page(clips, found, exhibits, judge))
        print(table(*point_rows(clips)))
        if found:
            print(f"\nIn a call of {FIRST_SHOWN_S:g} s:\n{table(*duel_rows(found, FIRST_SHOWN_S))}")
        say(f"bench: report.html, report.json and the calls are in {folder}")
    warn(f"{item.source} failed: {item.error}" for item in failures)
    return failures[0].error.exit_code if failures else 0


def run_replay(arguments: argparse.Namespace) -> int:
    """`risorius replay`."""
    from loopback.bench import make_folder
    from loopback.replay.checks import (
        baseline_changes,
        baseline_of,
        read_baseline,
        write_baseline,
    )
    from loopback.replay.outcome import junit_xml, replay_table
    from loopback.replay.runs import ClipResult, replay
    from loopback.replay.suite import read_suite
    from loopback.report import write_json, write_report

    suite, path = read_suite(arguments.suite), arguments.baseline
    updates = arguments.update_baseline
    if updates and path is None:
        raise UserError("--update-baseline writes the file of --baseline FILE; name one")
    known = {} if path is None or (updates and not path.exists()) else read_baseline(path)
    if arguments.junit:
        make_folder(arguments.junit.parent)
    check_outputs([arguments.suite], [arguments.junit, path if updates else None])
    folder, results = arguments.out, list[ClipResult]()
    with StopOnSignal():
        try:
            for result in replay(suite, folder, say, None if updates else known):
                results.append(result)
        finally:
            if results:
                write_json(folder / "report.json", {"clips": [item.figures for item in results]})
                print(replay_table(results))
                say(f"replay: report.json and the decoded videos are in {folder}")
    # Not of a part: a CI would take it for the whole.
    if arguments.junit:
        write_report(arguments.junit, junit_xml(suite, results))
    if updates:
        tolerances = {clip.name: clip.tolerances for clip in suite.clips}
        measured = {
            each.name: baseline_of(each.figures, tolerances[each.name])
            for each in results
            if each.error is None
        }
        # A clip that failed keeps what it had.
        now = {clip.name: known[clip.name] for clip in suite.clips if clip.name in known} | measured
        write_baseline(path, now)
        print(f"\n{baseline_changes(known, now) or 'the baseline is as it was'}")
        say(f"replay: {path} has been written: look at what has changed before you commit it")
    return 0 if all(result.passed for result in results) else 1
