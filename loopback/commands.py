"""What each command does, from parsed arguments to exit code.

A command imports the part it needs only when it runs: an encoder host has no renderer.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from loopback.outputs import check_outputs
from loopback.profiles import chosen_profile
from loopback.progress import ProgressLine
from loopback.report import json_text, write_json, write_report
from loopback.signals import StopOnSignal
from shared_model.errors import LINK_FAILED, UserError

if TYPE_CHECKING:
    from decoder.pipeline import DecodeReport
    from encoder.pipeline import EncodeReport
    from loopback.quality import Quality

Progress = Callable[[int, int | None], None]

INTERRUPTED = 130
NAP_S = 0.2


def run_encode(arguments: argparse.Namespace) -> int:
    """`risorius encode`."""
    from encoder.follow import FollowOptions
    from encoder.pipeline import EncodeOptions, encode
    from protocol.link import Reach

    check_outputs([arguments.source], [arguments.output], [arguments.report])
    profile = chosen_profile(arguments)
    _check_startup(arguments)
    over_link = arguments.output is None
    options = EncodeOptions(
        source=arguments.source,
        output=arguments.output,
        connect=tuple(arguments.connect or ()),
        listen=tuple(arguments.listen or ()),
        call=arguments.call,
        lossless=arguments.lossless,
        profile=profile,
        bitrate=arguments.bitrate,
        startup_bitrate=arguments.startup_bitrate,
        fps=arguments.fps,
        follow=FollowOptions(
            arguments.detector,
            arguments.tracker,
            arguments.without,
            arguments.normalise,
            arguments.abs,
            arguments.lids,
        ),
        pace=over_link if arguments.pace is None else arguments.pace,
        max_frames=arguments.max_frames,
        wait_for_peer_s=arguments.wait,
        look_for_face_s=arguments.look_for_face,
        model_bytes=arguments.model_bytes,
        live=arguments.live,
    )
    with StopOnSignal() as stop, _progress("encode", arguments) as progress:
        try:
            preparing = stop.watch_preparing(progress.preparing)
            report = encode(options, stop.watch(progress), stop, progress.say, preparing)
        except UserError as error:
            raise _reason(error, stop) from error
    _warn(report.warnings)
    if not arguments.quiet:
        print(_encode_summary(report))
    if arguments.report:
        write_json(arguments.report, report)
    return _exit_code(stop, link_failed=report.reach == Reach.NO_LINK)


def run_decode(arguments: argparse.Namespace) -> int:
    """`risorius decode`."""
    from decoder.pipeline import DecodeOptions, decode

    read = [arguments.call_file, arguments.source, arguments.face]
    check_outputs(read, [arguments.output], [arguments.report])
    with ExitStack() as stack:
        output: Path | None = arguments.output
        if output is None and arguments.source:
            output = Path(stack.enter_context(TemporaryDirectory())) / "decoded.mkv"
        options = DecodeOptions(
            call_file=arguments.call_file,
            listen=tuple(arguments.listen or ()),
            connect=tuple(arguments.connect or ()),
            call=arguments.call,
            connect_timeout_s=arguments.timeout,
            output=output,
            face=arguments.face,
        )
        stop = stack.enter_context(StopOnSignal())
        patience = Patience(arguments.timeout, stop)
        with _progress("decode", arguments) as progress:
            try:
                noted = patience.watch(stop.watch(progress))
                report = decode(options, noted, patience, progress.say)
            except UserError as error:
                raise _reason(error, stop, patience) from error
        if patience.expired and not report.complete:
            _warn([f"no picture came for {patience.timeout_s:g} s"])
        _warn(report.warnings)
        quality = (
            _quality(arguments, output, report.frames) if output and arguments.source else None
        )
    if not arguments.quiet:
        print(_decode_summary(report, quality))
    if arguments.report:
        figures = asdict(report) | ({"quality": asdict(quality)} if quality else {})
        write_json(arguments.report, figures)
    return _exit_code(stop, link_failed=not (arguments.call_file or report.complete))


def run_bench(arguments: argparse.Namespace) -> int:
    """`risorius bench`."""
    if arguments.sweep:
        return run_sweep(arguments)
    from loopback.bench import BenchSettings, bench, bench_page, bench_table
    from loopback.timings import timings_tables

    _check_startup(arguments)
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


def run_relay(arguments: argparse.Namespace) -> int:
    """`risorius relay`: being stopped is its normal end."""
    from protocol.link_zenoh import ZenohRouter

    with StopOnSignal(), suppress(KeyboardInterrupt), ZenohRouter(tuple(arguments.listen)):
        say(f"relay: listening on {' '.join(arguments.listen)}")
        while True:
            # Not for a signal: a thread of Zenoh may take it.
            time.sleep(NAP_S)
    return 0


def run_info(arguments: argparse.Namespace) -> int:
    """`risorius info`."""
    from loopback.information import summary_table
    from protocol.messages import ProtocolError
    from protocol.summary import summarise

    try:
        summary = summarise(arguments.call_file)
    except ProtocolError as error:
        raise UserError(f"{arguments.call_file}: {error}") from error
    if arguments.json:
        print(json_text(summary))
        return 0
    print(summary_table(summary))
    return 0


def run_animate(arguments: argparse.Namespace) -> int:
    """`risorius animate`."""
    from loopback.animate import AnimateOptions, animate

    check_outputs([arguments.script, arguments.call], [arguments.output], [arguments.truth])
    options = AnimateOptions(
        arguments.script, arguments.output, call_file=arguments.call, truth=arguments.truth
    )
    with StopOnSignal() as stop, _progress("animate", arguments) as progress:
        report = animate(options, progress, stop)
    if not arguments.quiet:
        print(f"{report.frames} pictures in {report.output}, the truth in {report.truth}")
    return INTERRUPTED if stop() else 0


def run_view(arguments: argparse.Namespace) -> int:
    """`risorius view`: being stopped is its normal end."""
    from loopback.view import ViewOptions, view

    with StopOnSignal(), suppress(KeyboardInterrupt):
        view(ViewOptions(arguments.call, arguments.port), lambda url: print(url, flush=True))
    return 0


def run_demo(arguments: argparse.Namespace) -> int:
    """`risorius demo`."""
    from loopback.demo import demo

    with StopOnSignal() as stop:
        print(demo(arguments.out, say, stop))
    return INTERRUPTED if stop() else 0


def say(message: str) -> None:
    """One line about the run, on stderr."""
    print(message, file=sys.stderr, flush=True)


class Patience:
    """A question to stop: also yes once no picture has come for `timeout_s`; 0 waits for ever."""

    def __init__(
        self,
        timeout_s: float,
        stop: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.timeout_s = timeout_s
        self._stop, self._clock = stop, clock
        self._last = clock()

    @property
    def expired(self) -> bool:
        """Nothing has come for too long."""
        return 0 < self.timeout_s < self._clock() - self._last

    def __call__(self) -> bool:
        return self._stop() or self.expired

    def watch(self, progress: Progress) -> Progress:
        """`progress`, with a note of the time whenever it is called."""

        def noted(done: int, total: int | None) -> None:
            self._last = self._clock()
            progress(done, total)

        return noted


def _progress(label: str, arguments: argparse.Namespace) -> ProgressLine:
    return ProgressLine(label, sys.stderr, arguments.quiet)


def _reason(
    error: UserError, stop: Callable[[], bool], patience: Patience | None = None
) -> BaseException:
    """Why nothing came of it: the user's wish, a failed link, a silent one, or the error."""
    if stop():
        return KeyboardInterrupt()
    if patience is not None and patience.expired and error.exit_code != LINK_FAILED:
        return UserError(f"nobody called within {patience.timeout_s:g} s", LINK_FAILED)
    return error


def _exit_code(stop: Callable[[], bool], link_failed: bool) -> int:
    if stop():
        return INTERRUPTED
    return LINK_FAILED if link_failed else 0


def _warn(warnings: Iterable[str]) -> None:
    for warning in warnings:
        say(f"risorius: warning: {warning}")


def _check_startup(arguments: argparse.Namespace) -> None:
    startup: float | None = arguments.startup_bitrate
    if startup is not None and startup <= arguments.bitrate:
        raise UserError(
            f"--startup-bitrate {startup:g} leaves nothing for the model"
            f" beside frames of --bitrate {arguments.bitrate:g}"
        )


def _quality(arguments: argparse.Namespace, decoded: Path, frames: int) -> "Quality":
    """Of the frames that the call has: its encoder may have been stopped before the source."""
    from encoder.capture import open_source
    from loopback.quality import face_area_finder, measure

    with open_source(arguments.source) as originals:
        if frames < (originals.frame_count or 0):
            say(f"risorius: warning: {arguments.source} goes on after the call's {frames} frames")
    with _progress("compare", arguments) as progress:
        return measure(arguments.source, str(decoded), face_area_finder(say), progress, frames)


def _encode_summary(report: "EncodeReport") -> str:
    busy_ms = sum(report.stage_ms.values())
    return (
        f"{report.frames} frames of {report.width}x{report.height} at {report.fps:.2f}/s,"
        f" {report.coded_fps:.2f}/s coded: model {report.model_bytes} bytes,"
        f" frames {report.frame_bytes} bytes; {busy_ms:.1f} ms a frame"
        f"{'' if report.reach == 'somebody' else '; nobody heard its end'}"
    )


def _decode_summary(report: "DecodeReport", quality: "Quality | None") -> str:
    busy_ms = sum(report.stage_ms.values())
    line = (
        f"{report.frames} frames of {report.width}x{report.height} at {report.fps:.2f}/s;"
        f" {busy_ms:.1f} ms a frame"
    )
    if quality is None:
        return line
    face = "-" if quality.face_psnr_db is None else f"{quality.face_psnr_db:.2f}"
    return f"{line}\nPSNR: face {face} dB, picture {quality.full_psnr_db:.2f} dB"
