"""`risorius encode`: the face in a video, sent as a call."""

import argparse
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from encoder.option_rules import Options, as_typed, checked_options, reject
from protocol.link.interface import LinkOptions, Reachability
from risorius.command_line.call_link import (
    add_link,
    check_place,
    check_ports,
    link_request,
    read_link,
)
from risorius.command_line.local_network import announced
from risorius.command_line.options import (
    SOURCE_HELP,
    add_coding,
    add_reporting,
    add_sound,
    add_tracking,
    add_transport,
    add_view,
)
from risorius.command_line.output_checks import check_call_file, check_outputs
from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, warn
from risorius.command_line.signals import StopOnSignal
from risorius.command_line.standard_streams import output_of
from runtime.child_process import start_fork_server
from shared_model.errors import LINK_FAILED, UserError

if TYPE_CHECKING:
    from encoder.options import EncodeOptions
    from encoder.report import EncodeReport
    from risorius.command_line.parser import Commands

# Options with an effect over a link only, and their defaults.
LINK_OPTIONS: Options = {"insecure": False, "keys": None, "lossless": False, "wait": 30.0}


def add_encode(added: "Commands") -> None:
    """`risorius encode`."""
    parser = add_command(
        added,
        "encode",
        "find the face in a video and send it as a call",
        "The call goes into a file (-o) or over Zenoh (--connect or --listen): the same bytes.",
        "  risorius encode me.mp4 -o call.rzo\n"
        "  risorius encode me.mp4 --live -o - | risorius decode - -o - | mpv -\n"
        "  risorius encode 0 --invite risorius://192.0.2.7:7447/anna#K7Q2-8MDX-...\n"
        "  risorius encode me.mp4 --connect 192.0.2.7:7447 --call anna --insecure\n"
        "  risorius encode 0 --listen :7447 --call anna --insecure   # then, on the same network,\n"
        "  risorius decode --call anna --view --insecure\n",
    )
    parser.add_argument("source", metavar="SOURCE", help=SOURCE_HELP)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="CALL",
        help="write a call file (.rzo); -: to standard output",
    )
    add_link(parser, where)
    add_coding(parser)
    add_sound(parser)
    add_tracking(parser)
    add_transport(parser)
    add_view(parser, "what is sent, as the other end draws it,")
    add_reporting(parser)
    parser.set_defaults(run=run_encode)


def run_encode(arguments: argparse.Namespace) -> int:
    """`risorius encode`."""
    check_place(arguments, "-o CALL", arguments.output is not None)
    check_outputs([arguments.source], [arguments.output, arguments.report])
    check_call_file(arguments.output)
    vars(arguments).update(checked_options(vars(arguments), as_typed))
    if arguments.output is not None:
        reject(vars(arguments), LINK_OPTIONS, "-o")
    check_ports(arguments)
    if arguments.profile == "default" and _is_in_real_time(arguments):
        # It loads while this process loads, and becomes the learning process.
        start_fork_server("encoder.live_model.warm_up", "load")
    from loopback.report import figures_of, write_json

    with ExitStack() as stack:
        link: LinkOptions | None = None
        if arguments.output is None:
            link = replace(
                read_link(link_request(arguments), is_encoder=True, wait_s=arguments.wait),
                lossless=arguments.lossless,
                rate_bps=arguments.startup_bitrate,
            )
            needs_key = link.security.key is not None
            stack.enter_context(announced(link.call, link.listen, True, needs_key))
        options = _encode_options(arguments, link)
        if arguments.view:
            from risorius.call_page.call_view import SentView

            view = stack.enter_context(SentView(arguments.port))
            options = replace(options, monitor=view.stream)
        stop = stack.enter_context(StopOnSignal())
        report = _encode(options, stop, arguments.quiet)
        warn(report.warnings)
        if not arguments.quiet:
            print(f"{'interrupted: ' if stop() else ''}{_encode_summary(report)}")
    if arguments.report:
        write_json(arguments.report, figures_of(report))
    if stop():
        return INTERRUPTED
    return LINK_FAILED if report.reach == Reachability.NO_LINK else 0


def _is_in_real_time(arguments: argparse.Namespace) -> bool:
    """Whether the source does not wait: a camera, or a file at its own rate."""
    is_camera = arguments.source.isdecimal() or "://" in arguments.source
    return is_camera or (arguments.live and arguments.pace)


def _encode(options: "EncodeOptions", stop: StopOnSignal, quiet: bool) -> "EncodeReport":
    with ProgressLine("encode", sys.stderr, quiet) as progress:
        progress.preparing("starting")
        from encoder.pipeline import encode

        progress.preparing("")
        try:
            preparing = stop.watch_preparing(progress.preparing)
            return encode(options, stop.watch(progress), stop, progress.say, preparing)
        except UserError as error:
            if stop():
                raise KeyboardInterrupt from error
            raise


def _encode_options(arguments: argparse.Namespace, link: LinkOptions | None) -> "EncodeOptions":
    from encoder.options import EncodeOptions
    from encoder.thesis.tracking_options import TrackingOptions
    from risorius.call_drawing import draw
    from risorius.statistical_model import expression_search, landmark_source

    nose = None if arguments.nose_cascade is None else Path(arguments.nose_cascade)
    return EncodeOptions(
        source=arguments.source,
        output=output_of(arguments.output),
        link=link,
        draw=draw,
        profile=arguments.profile,
        texture_modes=arguments.texture_modes,
        bitrate=arguments.bitrate,
        startup_bitrate=arguments.startup_bitrate,
        fps=arguments.fps,
        tracking=TrackingOptions(
            arguments.detector,
            arguments.tracker,
            arguments.without,
            arguments.normalise,
            arguments.abs,
            arguments.lids,
            arguments.refine,
            landmark_source(arguments.aam, nose, arguments.aam_every_frame),
            nose,
            arguments.klt_points,
            arguments.projection,
            arguments.free_focal,
            expression_search(arguments.aam if arguments.aam_feedback else None),
        ),
        pace=link is not None if arguments.pace is None else arguments.pace,
        max_frames=arguments.max_frames,
        wait_for_peer_s=arguments.wait,
        look_for_face_s=arguments.look_for_face,
        model_bytes=arguments.model_bytes,
        low_delay=arguments.low_delay,
        live=arguments.live,
        delay_s=arguments.delay,
        voice=arguments.voice,
    )


def _encode_summary(report: "EncodeReport") -> str:
    busy_ms = sum(report.stages.stage_ms.values())
    times, sent, speech = report.work.frame_ms, report.sent, report.speech
    frame = f", {times['p95']:.1f} at most in 95 of 100" if times else ""
    voice = f", voice {speech.voice_bytes} bytes" if speech.voice != "off" else ""
    return (
        f"{report.frames} frames of {report.width}x{report.height} at {report.fps:.2f}/s,"
        f" {report.coded_fps:.2f}/s coded: model {sent.model_bytes} bytes,"
        f" frames {sent.frame_bytes} bytes{voice}; {busy_ms:.1f} ms a frame{frame}"
        f"{'' if report.reach == 'somebody' else '; nobody heard its end'}"
    )
