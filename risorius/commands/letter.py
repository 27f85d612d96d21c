"""`risorius letter`: a video or a call as one HTML file that plays it anywhere."""

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from encoder.option_rules import CHOICES, as_typed, checked_options, reject
from risorius.command_line.argument_types import bitrate, count, model_bytes
from risorius.command_line.options import SOURCE_HELP
from risorius.command_line.output_checks import check_letter_name, check_outputs
from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

CALL_SUFFIX = ".rzo"
# What only the encoder takes, and so does not go with a call file.
ENCODER_OPTIONS = ("bitrate", "model_bytes", "max_frames", "voice")


def add_letter(added: "Commands") -> None:
    """`risorius letter`."""
    parser = add_command(
        added,
        "letter",
        "make one HTML file of a video or a call, which plays it in any browser",
        "The file has everything in it, the player and the call, and needs no server and no\n"
        "network: send it by mail, open it on a phone.  It weighs about 165 kB and 8 kB for each\n"
        "minute, 50 to 75 kB with a voice.  A camera's is coded in one pass, and softer.",
        "  risorius letter me.mp4 -o me.html\n"
        "  risorius letter call.rzo -o call.html\n"
        "  risorius letter 0 -o hello.html            # from the camera; Ctrl-C ends it\n",
    )
    parser.add_argument("source", metavar="SOURCE", help=f"call file (.rzo), {SOURCE_HELP}")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="LETTER", help="the file, .html"
    )
    parser.add_argument(
        "--bitrate",
        type=bitrate,
        metavar="BPS",
        help="of a video: bits a second of the face (default: 800)",
    )
    parser.add_argument(
        "--model-bytes",
        type=model_bytes,
        metavar="N",
        help="of a video: about as large the model shall be (default: 12000, more above 1200"
        " bit/s)",
    )
    parser.add_argument(
        "--max-frames", type=count, metavar="N", help="of a video: stop after N frames"
    )
    parser.add_argument(
        "--voice",
        choices=CHOICES["voice"],
        help="of a video: code its sound track; the letter has it as Opus (default: 1200 where the"
        " source has sound and the codec is installed)",
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress, no summary")
    parser.set_defaults(run=run_letter)


def run_letter(arguments: argparse.Namespace) -> int:
    """`risorius letter`."""
    output: Path = arguments.output
    check_outputs([arguments.source], [output])
    check_letter_name(output)
    is_call = arguments.source.lower().endswith(CALL_SUFFIX)
    if is_call:
        reject(vars(arguments), dict.fromkeys(ENCODER_OPTIONS), "a call file")
    from risorius.letter.letter_file import write_letter

    with ExitStack() as stack:
        stop = stack.enter_context(StopOnSignal())
        call = Path(arguments.source)
        if not is_call:
            call = Path(stack.enter_context(TemporaryDirectory())) / "call.rzo"
            _encode(arguments, call, stop)
        size = write_letter(call, output, Path(arguments.source).stem, warn)
        if not arguments.quiet:
            print(f"{output}: {size / 1e3:.1f} kB, the call {call.stat().st_size / 1e3:.1f} kB")
        return INTERRUPTED if stop() else 0


def _encode(arguments: argparse.Namespace, call: Path, stop: StopOnSignal) -> None:
    """Encode the source of a letter into a call file."""
    with ProgressLine("letter", sys.stderr, arguments.quiet) as progress:
        progress.preparing("starting")
        from encoder.options import EncodeOptions
        from encoder.pipeline import encode
        from risorius.call_drawing import draw

        progress.preparing("")
        options = EncodeOptions(
            source=arguments.source,
            output=call,
            draw=draw,
            profile=str(checked_options(vars(arguments), as_typed)["profile"]),
            bitrate=arguments.bitrate or 800.0,
            model_bytes=arguments.model_bytes,
            max_frames=arguments.max_frames,
            voice=arguments.voice,
        )
        try:
            preparing = stop.watch_preparing(progress.preparing)
            report = encode(options, stop.watch(progress), stop, progress.say, preparing)
        except UserError as error:
            if stop():
                raise KeyboardInterrupt from error
            raise
        warn(report.warnings)
