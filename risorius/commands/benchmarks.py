"""`risorius bench` and `risorius replay`: recorded videos, measured."""

import argparse
import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from risorius.command_line.argument_types import bitrates
from risorius.command_line.option_rules import OPTIONS_NOT_FOR_SWEEP, profile_of, reject
from risorius.command_line.options import add_coding
from risorius.command_line.output_checks import check_output_folder, check_outputs
from risorius.command_line.parser import add_command
from risorius.command_line.progress import ProgressLine, say, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_bench(added: "Commands") -> None:
    """`risorius bench`."""
    parser = add_command(
        added,
        "bench",
        "measure bits, PSNR and latency of recorded videos",
        "Encoder and decoder run as two processes that talk over Zenoh on this host.  Latency is\n"
        "from the reading of a frame to its picture; in the default profile, unless it is --live,\n"
        "both passes over the file are in between.\n"
        "With --sweep each clip gets one model and is coded at several rates into call files.",
        "  risorius bench me.mp4 you.mp4 --out out/bench\n"
        "  risorius bench --timings --no-pace me.mp4\n"
        "  risorius bench --sweep 200,350,500,800,1200,2000 me.mp4 --out out/sweep\n",
    )
    parser.add_argument("source", nargs="+", metavar="SOURCE", help="video file or image pattern")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="decoded videos, report.json and report.html go here (default: out/bench, of a"
        " sweep out/sweep)",
    )
    add_coding(parser)
    _add_measuring(parser)
    parser.set_defaults(run=run_bench)


def _add_measuring(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--sweep",
        type=bitrates,
        metavar="BPS,...",
        help="draw the default profile's PSNR over these rates; goes on where it was stopped",
    )
    parser.add_argument(
        "--timings",
        action="store_true",
        help="also print where the time of both ends goes: ms a frame of each stage",
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
        "  risorius replay suite.toml --junit out/junit.xml\n",
    )
    parser.add_argument("suite", type=Path, metavar="SUITE", help="suite of clips (.toml)")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/replay"),
        metavar="DIR",
        help="decoded videos and report.json go here (default: %(default)s)",
    )
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    parser.set_defaults(run=run_replay)


def run_bench(arguments: argparse.Namespace) -> int:
    """`risorius bench`."""
    if arguments.sweep:
        return run_sweep(arguments)
    profile = profile_of(arguments)
    from loopback.bench import (
        BenchSettings,
        ClipFailure,
        bench,
        bench_page,
        bench_report,
        bench_table,
    )
    from loopback.report import write_json, write_report
    from loopback.timing_tables import timings_tables

    # A setting has the name of its option.
    given = {item.name: getattr(arguments, item.name) for item in fields(BenchSettings)}
    settings = BenchSettings(**{**given, "profile": profile})
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
                write_report(folder / "report.html", bench_page(clips).encode())
                print(bench_table(clips))
                if arguments.timings:
                    print(f"\n{timings_tables(clips)}")
                say(f"bench: report.json, report.html and the decoded videos are in {folder}")
    return failures[0].error.exit_code if failures else 0


def run_sweep(arguments: argparse.Namespace) -> int:
    """`risorius bench --sweep`."""
    if arguments.timings:
        raise UserError("--timings is about calls between two processes; leave out --sweep")
    if arguments.profile == "thesis":
        raise UserError("--sweep is about the default profile; leave out --profile thesis")
    reject(arguments, OPTIONS_NOT_FOR_SWEEP, "--sweep")
    from loopback.sweep import SweepSettings, sweep, sweep_table

    settings = SweepSettings(arguments.sweep, arguments.max_frames)

    def progress(label: str) -> ProgressLine:
        return ProgressLine(label, sys.stderr)

    folder = arguments.out or Path("out/sweep")
    check_output_folder(folder)
    report, failures = sweep(arguments.source, settings, folder, say, progress)
    print(sweep_table(report))
    say(f"sweep: report.json, rate_distortion.svg, .png and the calls are in {folder}")
    warn(f"{item.source} failed: {item.error}" for item in failures)
    return failures[0].error.exit_code if failures else 0


def run_replay(arguments: argparse.Namespace) -> int:
    """`risorius replay`."""
    from loopback.bench import make_folder
    from loopback.replay import ClipResult, junit_xml, read_suite, replay, replay_table
    from loopback.report import write_json, write_report

    suite = read_suite(arguments.suite)
    if arguments.junit:
        make_folder(arguments.junit.parent)
    check_outputs([arguments.suite], [arguments.junit])
    folder, results = arguments.out, list[ClipResult]()
    with StopOnSignal():
        try:
            for result in replay(suite, folder, say):
                results.append(result)
        finally:
            if results:
                write_json(folder / "report.json", {"clips": [item.figures for item in results]})
                print(replay_table(results))
                say(f"replay: report.json and the decoded videos are in {folder}")
    # Not of a part: a CI would take it for the whole.
    if arguments.junit:
        write_report(arguments.junit, junit_xml(suite, results))
    return 0 if all(result.passed for result in results) else 1
