"""What the commands do that measure recorded videos, from parsed arguments to exit code.

They import what they need only when they run, as `commands` do.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from loopback.report import write_json, write_report
from risorius.command_line.option_rules import (
    UNSWEPT_OPTIONS,
    check_startup,
    chosen_profile,
    refuse,
)
from risorius.command_line.output_checks import check_outputs
from risorius.command_line.progress import ProgressLine, say
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError


def run_bench(arguments: argparse.Namespace) -> int:
    """`risorius bench`."""
    if arguments.sweep:
        return run_sweep(arguments)
    from loopback.bench import BenchSettings, bench, bench_page, bench_report, bench_table
    from loopback.timing_tables import timings_tables

    check_startup(arguments)
    settings = BenchSettings(
        profile=chosen_profile(arguments),
        bitrate=arguments.bitrate,
        fps=arguments.fps,
        detector=arguments.detector,
        lids=arguments.lids,
        refine=arguments.refine,
        max_frames=arguments.max_frames,
        pace=arguments.pace,
        model_bytes=arguments.model_bytes,
        live=arguments.live,
        startup_bitrate=arguments.startup_bitrate,
    )
    folder, clips = arguments.out or Path("out/bench"), list[dict[str, Any]]()
    with StopOnSignal():
        try:
            for figures in bench(arguments.source, settings, folder, say):
                clips.append(figures)
        finally:
            # Whatever stopped the others, what was measured is kept.
            if clips:
                write_json(folder / "report.json", bench_report(settings, clips))
                write_report(folder / "report.html", bench_page(clips).encode())
                print(bench_table(clips))
                if arguments.timings:
                    print(f"\n{timings_tables(clips)}")
                say(f"bench: report.json, report.html and the decoded videos are in {folder}")
    return 0


def run_sweep(arguments: argparse.Namespace) -> int:
    """`risorius bench --sweep`."""
    if arguments.timings:
        raise UserError("--timings is about calls between two processes; leave out --sweep")
    from loopback.sweep import SweepSettings, sweep, sweep_table

    if arguments.profile == "thesis":
        raise UserError("--sweep is about the default profile; leave out --profile thesis")
    refuse(arguments, UNSWEPT_OPTIONS, "--sweep")
    settings = SweepSettings(arguments.sweep, arguments.max_frames)

    def progress(label: str) -> ProgressLine:
        return ProgressLine(label, sys.stderr)

    folder = arguments.out or Path("out/sweep")
    print(sweep_table(sweep(arguments.source, settings, folder, say, progress)))
    say(f"sweep: report.json, rate_distortion.svg, .png and the calls are in {folder}")
    return 0


def run_replay(arguments: argparse.Namespace) -> int:
    """`risorius replay`."""
    from loopback.replay import ClipResult, junit_xml, read_suite, replay, replay_table

    check_outputs([arguments.suite], [], [arguments.junit])
    suite = read_suite(arguments.suite)
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
