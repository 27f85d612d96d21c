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

from loopback.report import json_text, write_json
from risorius.command_line.option_rules import (
    DECODE_LINK_OPTIONS,
    ENCODE_LINK_OPTIONS,
    check_startup,
    chosen_profile,
    refuse,
)
from risorius.command_line.output_checks import check_call_file, check_outputs
from risorius.command_line.progress import ProgressLine, say
from risorius.command_line.signals import StopOnSignal
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
    from encoder.pipeline import EncodeOptions, encode
    from encoder.tracking.trackers import FollowOptions
    from protocol.link.interface import Reach

    check_outputs([arguments.source], [arguments.output], [arguments.report])
    check_call_file(arguments.output)
    profile = chosen_profile(arguments)
    check_startup(arguments)
    over_link = arguments.output is None
    if not over_link:
        refuse(arguments, ENCODE_LINK_OPTIONS, "-o")
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
            arguments.refine,
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
        print(f"{'interrupted: ' if stop() else ''}{_encode_summary(report)}")
    if arguments.report:
        write_json(arguments.report, report)
    return _exit_code(stop, link_failed=report.reach == Reach.NO_LINK)


def run_decode(arguments: argparse.Namespace) -> int:
    """`risorius decode`."""
    from decoder.pipeline import DecodeOptions, decode

    read = [arguments.call_file, arguments.source, arguments.face]
    check_outputs(read, [arguments.output], [arguments.report])
    if arguments.call_file is not None:
        refuse(arguments, DECODE_LINK_OPTIONS, "a call file")
    if arguments.source:
        _check_source(arguments)
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
        if not arguments.quiet:
            print(_decode_summary(report))
        figures = asdict(report)
        try:
            if output and arguments.source:
                quality = _quality(arguments, output, report.frames)
                figures["quality"] = asdict(quality)
                if not arguments.quiet:
                    print(_quality_summary(quality))
        finally:
            if arguments.report:
                write_json(arguments.report, figures)
    return _exit_code(stop, link_failed=not (arguments.call_file or report.complete))


def run_relay(arguments: argparse.Namespace) -> int:
    """`risorius relay`: being stopped is its normal end."""
    from protocol.link.zenoh_link import ZenohRouter

    with StopOnSignal(), suppress(KeyboardInterrupt), ZenohRouter(tuple(arguments.listen)):
        say(f"relay: listening on {' '.join(arguments.listen)}")
        while True:
            # Not for a signal: a thread of Zenoh may take it.
            time.sleep(NAP_S)
    return 0


def run_info(arguments: argparse.Namespace) -> int:
    """`risorius info`."""
    from decoder.duration import source_frames
    from protocol.packets import ProtocolError
    from protocol.summary import summarise
    from risorius.command_line.info_table import summary_table

    path: Path = arguments.call_file
    try:
        summary = summarise(path)
        if not summary.complete:
            summary = summarise(path, source_frames(path))
    except ProtocolError as error:
        raise UserError(f"{path}: {error}") from error
    if not summary.complete:
        reason = "damaged" if summary.damaged_packets else "cut off"
        _warn([f"{path} is {reason}: these are the figures of what is there"])
    if summary.damaged_packets:
        _warn([f"damaged packets, left out: {summary.damaged_packets}"])
    if summary.trailing_bytes:
        _warn([f"{summary.trailing_bytes} bytes after the end of the call are left out"])
    if arguments.json:
        print(json_text(summary))
        return 0
    print(summary_table(summary))
    return 0


def run_animate(arguments: argparse.Namespace) -> int:
    """`risorius animate`."""
    from risorius.animation.animate import AnimateOptions, animate

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
    from risorius.view.server import ViewOptions, view

    with StopOnSignal(), suppress(KeyboardInterrupt):
        view(ViewOptions(arguments.call, arguments.port), lambda url: print(url, flush=True))
    return 0


def run_demo(arguments: argparse.Namespace) -> int:
    """`risorius demo`."""
    from risorius.demo import demo

    with StopOnSignal() as stop:
        print(demo(arguments.out, say, stop))
    return INTERRUPTED if stop() else 0


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


def _check_source(arguments: argparse.Namespace) -> None:
    """Raise `UserError` if what is to be decoded cannot be compared with its source afterwards."""
    from decoder.reenactment import read_model
    from encoder.capture.video_source import open_source
    from loopback.quality import check_size

    with open_source(arguments.source) as originals:
        if arguments.call_file is not None:
            call = read_model(arguments.call_file).call
            check_size(originals, str(arguments.call_file), call.width, call.height)


def _quality(arguments: argparse.Namespace, decoded: Path, frames: int) -> "Quality":
    """Of the frames that the call has: its encoder may have been stopped before the source."""
    from encoder.capture.video_source import open_source
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


def _decode_summary(report: "DecodeReport") -> str:
    busy_ms = sum(report.stage_ms.values())
    return (
        f"{report.frames} frames of {report.width}x{report.height} at {report.fps:.2f}/s;"
        f" {busy_ms:.1f} ms a frame"
    )


def _quality_summary(quality: "Quality") -> str:
    face = (
        "no face measured"
        if quality.face_psnr_db is None
        else f"face {quality.face_psnr_db:.2f} dB"
    )
    return f"PSNR: {face}, picture {quality.full_psnr_db:.2f} dB"
