"""`risorius decode`: the pictures of a call, and their PSNR."""

import argparse
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from encoder.option_rules import Options, reject
from protocol.link.interface import LinkOptions
from risorius.command_line.call_link import (
    add_link,
    check_place,
    check_ports,
    link_request,
    read_link,
)
from risorius.command_line.idle_timeout import IdleTimeout
from risorius.command_line.local_network import announced
from risorius.command_line.options import (
    add_comparison,
    add_reporting,
    add_timeout,
    add_view,
)
from risorius.command_line.output_checks import STANDARD, check_outputs, is_letter
from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, say, warn
from risorius.command_line.signals import StopOnSignal
from risorius.command_line.standard_streams import input_of, output_of
from shared_model.errors import LINK_FAILED, UserError

if TYPE_CHECKING:
    from decoder.pipeline import DecodeReport
    from loopback.quality.video_quality import Quality
    from risorius.call_page.call_view import CallView
    from risorius.command_line.parser import Commands

# What a letter does not go with, and the values that stand for nothing.
# Options with an effect over a link only, and their defaults.
LINK_OPTIONS: Options = {"insecure": False, "keys": None, "timeout": 0.0}
LETTER_REJECTS: Options = {"source": None, "face": None, "view": False, "report": None}
# Below this PSNR of the whole picture source and call can hardly be of the same recording.
UNRELATED_DB = 13.0


def add_decode(added: "Commands") -> None:
    """`risorius decode`."""
    parser = add_command(
        added,
        "decode",
        "draw the face of a call",
        "The call comes from a file or over Zenoh (--listen or --connect).  The video has one\n"
        "frame per source frame, in the source's size and rate; .mkv is lossless (H.264), but for\n"
        "the rounding of Y'CbCr where the source is tagged BT.709: then the video is, too.",
        "  risorius decode call.rzo -o out.mkv --source me.mp4\n"
        "  risorius decode call.rzo --face anna.rzo -o anna.mkv\n"
        "  risorius decode call.rzo -o - | mpv -\n"
        "  risorius decode --listen :7447 --call anna --view       # prints an invitation\n"
        "  risorius decode --invite risorius://192.0.2.7:7447/anna#K7Q2-8MDX-... --view\n",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "call_file",
        nargs="?",
        type=Path,
        metavar="CALL",
        help="call file (.rzo); -: from standard input",
    )
    add_link(parser, where)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="VIDEO",
        help=".mkv .avi .mp4 .mov .webm, or frame%%04d.png; .html: a page that plays it, see"
        " risorius letter; -: YUV4MPEG2 to standard output, as mpv and ffplay read it; without it"
        " the call is only checked",
    )
    add_comparison(parser)
    add_timeout(parser)
    add_view(parser, "the call")
    add_reporting(parser)
    parser.set_defaults(run=run_decode)


def run_decode(arguments: argparse.Namespace) -> int:
    """`risorius decode`."""
    _check_arguments(arguments)
    if is_letter(arguments.output):
        return _write_letter(arguments)
    from loopback.report import figures_of, write_json

    with ExitStack() as stack:
        frames = _frames_to_compare(arguments) if arguments.source else None
        output: Path | None = arguments.output
        if output is None and arguments.source:
            output = Path(stack.enter_context(TemporaryDirectory())) / "decoded.mkv"
        link: LinkOptions | None = None
        if arguments.call_file is None:
            link = read_link(link_request(arguments), is_encoder=False, wait_s=arguments.timeout)
            needs_key = link.security.key is not None
            stack.enter_context(announced(link.call, link.listen, False, needs_key))
        stop = stack.enter_context(StopOnSignal())
        report = _decode(arguments, link, output, stop)
        if not arguments.quiet:
            print(_decode_summary(report))
        figures = figures_of(report)
        try:
            if output and arguments.source:
                quality = _quality(arguments, output, report.frames, frames)
                figures["quality"] = quality.figures()
                if not arguments.quiet:
                    print(quality_summary(quality))
        finally:
            if arguments.report:
                write_json(arguments.report, figures)
    if stop():
        return INTERRUPTED
    return 0 if arguments.call_file or report.complete else LINK_FAILED


def _check_arguments(arguments: argparse.Namespace) -> None:
    """Raise `UserError` for what is wrong before anything is read or waited for."""
    check_place(arguments, "a call file", arguments.call_file is not None)
    read = [arguments.call_file, arguments.source, arguments.face]
    check_outputs(read, [arguments.output, arguments.report])
    if arguments.call_file is not None:
        reject(vars(arguments), LINK_OPTIONS, "a call file")
    if is_letter(arguments.output):
        if arguments.call_file in (None, STANDARD):
            raise UserError("a letter is made of a call file; record the call with -o CALL first")
        reject(vars(arguments), LETTER_REJECTS, "a letter")
    elif arguments.output is not None and arguments.output != STANDARD:
        from decoder.sinks.frame_sink import check_sink

        check_sink(arguments.output)
    check_ports(arguments)
    if arguments.source and arguments.output == STANDARD:
        raise UserError("--source does not go with -o -; leave out -o, or name a file")


def _write_letter(arguments: argparse.Namespace) -> int:
    from risorius.letter.letter_file import write_letter

    path: Path = arguments.call_file
    size = write_letter(path, arguments.output, path.stem, warn)
    if not arguments.quiet:
        print(f"{arguments.output}: {size / 1e3:.1f} kB")
    return 0


def _decode(
    arguments: argparse.Namespace, link: LinkOptions | None, output: Path | None, stop: StopOnSignal
) -> "DecodeReport":
    from decoder.pipeline import DecodeOptions, decode

    options = DecodeOptions(
        call_file=input_of(arguments.call_file),
        link=link,
        output=output_of(output),
        face=arguments.face,
    )
    idle = IdleTimeout(arguments.timeout, stop)
    with ExitStack() as stack:
        view = _view(arguments, link, idle, stack) if arguments.view else None
        # Who looks at what is sent would hear an echo.
        is_heard = view is not None and arguments.call_file != STANDARD
        progress = stack.enter_context(ProgressLine("decode", sys.stderr, arguments.quiet))
        try:
            report = decode(
                options,
                idle.watch(stop.watch(progress)),
                idle,
                progress.say,
                view.show if view is not None else None,
                view.play if view is not None and is_heard else None,
                # Pages do not draw another one's face.
                view if arguments.face is None else None,
            )
        except UserError as error:
            raise _reason(error, stop, idle) from error
    if idle.expired and not report.complete:
        warn([f"no picture came for {idle.timeout_s:g} s"])
    warn(report.warnings)
    return report


def _view(
    arguments: argparse.Namespace,
    link: LinkOptions | None,
    stop: Callable[[], bool],
    stack: ExitStack,
) -> "CallView":
    """What shows each picture on a page until `stack` is closed."""
    from risorius.call_page.call_view import CallView

    path: Path | None = arguments.call_file
    is_recorded = path is not None and path != STANDARD
    name = "What is sent" if path is None or path == STANDARD else path.name
    if link is not None:
        name = link.call

    def announce(address: str) -> None:
        say(f"decode: the call is shown at {address}")

    view = CallView(announce, name, arguments.port, is_recorded, path is not None, stop)
    return stack.enter_context(view)


def _reason(error: UserError, stop: Callable[[], bool], idle: IdleTimeout) -> BaseException:
    """What to raise: the user's interrupt, a link that stayed silent, or the error."""
    if stop():
        return KeyboardInterrupt()
    if idle.expired and error.exit_code != LINK_FAILED:
        return UserError(f"no call came within {idle.timeout_s:g} s", LINK_FAILED)
    return error


def _frames_to_compare(arguments: argparse.Namespace) -> int | None:
    """How many frames of a call file the source has; None: the call is not known yet.

    Raises `UserError` if the pictures of the call cannot be compared with the source's.
    """
    from decoder.playout.duration import count_frames
    from decoder.scene.reenactment import read_model
    from encoder.capture.video_source import open_source
    from loopback.quality.video_quality import check_size

    path: Path | None = arguments.call_file
    with open_source(arguments.source) as originals:
        if path is None or path == STANDARD:
            return None
        call = read_model(path).call
        check_size(originals, str(path), *call.source_size)
    return _common_frames(arguments.source, count_frames(path))


def _common_frames(source: str, frames: int) -> int:
    """How many of `frames` the source has, and a warning if it has more or fewer."""
    from loopback.quality.video_quality import source_frame_count

    available = source_frame_count(source, frames)
    common = min(available, frames)
    if available != frames:
        warn([f"{source} has {available} frames, the call {frames}: PSNR of the first {common}"])
    return common


def _quality(
    arguments: argparse.Namespace, decoded: Path, shown: int, known: int | None
) -> "Quality":
    """PSNR of the frames that source and video have.

    shown: frames of the video.  known: those that source and call have, None if not known yet.
    """
    from loopback.quality.video_quality import face_mask_finder, measure_quality

    source = arguments.source
    frames = _common_frames(source, shown) if known is None else min(known, shown)
    with ProgressLine("compare", sys.stderr, arguments.quiet) as progress:
        finder = face_mask_finder(say)
        quality = measure_quality(source, str(decoded), finder, progress, frames, is_strict=False)
    if quality.frames < frames:
        warn([f"{source} ends after {quality.frames} frames: PSNR of these"])
    if quality.full_psnr_db is not None and quality.full_psnr_db < UNRELATED_DB:
        warn([f"this PSNR is that of unrelated pictures: is {source} what the call was made of?"])
    return quality


def _decode_summary(report: "DecodeReport") -> str:
    busy_ms = sum(report.stages.stage_ms.values())
    return (
        f"{report.frames} frames of {report.width}x{report.height} at {report.fps:.2f}/s;"
        f" {busy_ms:.1f} ms a frame"
    )


def quality_summary(quality: "Quality") -> str:
    """The PSNR, in one line."""
    if quality.full_psnr_db is None:
        return "PSNR: no picture measured"
    face = (
        "no face measured"
        if quality.face_psnr_db is None
        else f"face {quality.face_psnr_db:.2f} dB"
    )
    return f"PSNR: {face}, picture {quality.full_psnr_db:.2f} dB"
