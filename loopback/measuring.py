"""What the commands do that measure recorded videos, from parsed arguments to exit code.

They import what they need only when they run, as `commands` do.
"""

import argparse
import sys

from loopback.outputs import check_outputs
from loopback.profiles import check_startup, chosen_profile
from loopback.progress import ProgressLine, say
from loopback.report import write_json, write_report
from shared_model.errors import UserError


def run_bench(arguments: argparse.Namespace) -> int:
    """`risorius bench`."""
    if arguments.sweep:
        return run_sweep(arguments)
    from loopback.bench import BenchSettings, bench, bench_page, bench_table
    from loopback.timings import timings_tables

    check_startup(arguments)
    settings = BenchSettings(
        profile=chosen_profile(arguments),
        bitrate=arguments.bitrate,
        fps=arguments.fps,
        detector=arguments.detector,
        lids=arguments.lids,
        max_frames=arguments.max_frames,
        pace=arguments.pace,
        model_bytes=arguments.model_bytes,
        live=arguments.live,
        startup_bitrate=arguments.startup_bitrate,
    )
    report = bench(arguments.source, settings, arguments.out, say)
    write_json(arguments.out / "report.json", report)
    write_report(arguments.out / "report.html", bench_page(report["clips"]).encode())
    print(bench_table(report["clips"]))
    if arguments.timings:
        print(f"\n{timings_tables(report['clips'])}")
    return 0


def run_sweep(arguments: argparse.Namespace) -> int:
    """`risorius bench --sweep`."""
    if arguments.timings:
        raise UserError("--timings is about calls between two processes; leave out --sweep")
    from loopback.sweep import SweepSettings, sweep, sweep_table

    if arguments.fps is not None:
        raise UserError("--sweep codes every frame; leave out --fps")
    if arguments.live or arguments.startup_bitrate is not None:
        raise UserError("--sweep codes what it has seen whole; leave out --live, --startup-bitrate")
    if arguments.profile == "thesis" or arguments.lids:
        raise UserError("--sweep is about the default profile; leave out --profile thesis, --lids")
    settings = SweepSettings(arguments.sweep, arguments.max_frames)

    def progress(label: str) -> ProgressLine:
        return ProgressLine(label, sys.stderr)

    report = sweep(arguments.source, settings, arguments.out, say, progress)
    print(sweep_table(report))
    return 0


def run_replay(arguments: argparse.Namespace) -> int:
    """`risorius replay`."""
    from loopback.replay import junit_xml, read_suite, replay, replay_table

    check_outputs([arguments.suite], [], [arguments.junit])
    suite = read_suite(arguments.suite)
    results = replay(suite, arguments.out, say)
    write_json(arguments.out / "report.json", {"clips": [result.figures for result in results]})
    print(replay_table(results))
    if arguments.junit:
        write_report(arguments.junit, junit_xml(suite, results))
    return 0 if all(result.passed for result in results) else 1
