"""`risorius track`: pose, actuators and action units of a face, frame by frame."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from encoder.option_rules import as_typed, check_model_is_named
from risorius.command_line.argument_types import count
from risorius.command_line.options import SOURCE_HELP, add_statistical_model
from risorius.command_line.output_checks import STANDARD, check_outputs
from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, say, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_track(added: "Commands") -> None:
    """`risorius track`."""
    parser = add_command(
        added,
        "track",
        "write down how a face moves, frame by frame",
        "CSV with a line for each frame: time, pose (degrees, mm), actuators (EAUs), intensities\n"
        "of FACS action units, similarity to six emotions and confidence, each from 0 to 1.  A\n"
        "frame without a face has empty cells.  docs/tracker.md says how it is followed,\n"
        "docs/model.md what columns mean.\n"
        "A file NAME.json gets the same as JSON; --format openface has the columns of OpenFace.",
        "  risorius track me.mp4 -o me.csv\n  risorius track me.mp4 -o me.json\n"
        "  risorius track me.mp4 --format openface -o me.csv\n  risorius track 0 | head\n",
    )
    parser.add_argument("source", metavar="SOURCE", help=SOURCE_HELP)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=STANDARD,
        metavar="FILE",
        help="file to write; -: standard output (default: -)",
    )
    parser.add_argument(
        "--format",
        choices=("csv", "openface", "json"),
        help="what to write (default: by the file's suffix, else csv)",
    )
    add_statistical_model(parser, "")
    parser.add_argument(
        "--max-frames", type=count, metavar="N", help="stop after N frames of the source"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    parser.set_defaults(run=run_track)


def run_track(arguments: argparse.Namespace) -> int:
    """`risorius track`: what was tracked until it is stopped is written."""
    check_outputs([arguments.source], [arguments.output])
    check_model_is_named(vars(arguments), as_typed)
    from risorius.face_track import track
    from risorius.track_files import FORMATS

    progress_line = ProgressLine("track", sys.stderr, arguments.quiet)
    with StopOnSignal() as stop, progress_line as progress:
        try:
            watched = stop.watch(progress)
            found = track(
                arguments.source,
                arguments.max_frames,
                watched,
                stop,
                arguments.aam,
                aam_feedback=arguments.aam_feedback,
            )
        except UserError as error:
            if stop():
                raise KeyboardInterrupt from error
            raise
    warn(found.warnings)
    if arguments.output == STANDARD:
        sys.stdout.write(FORMATS[arguments.format or "csv"](found.columns))
    else:
        found.write(arguments.output, arguments.format)
    if stop():
        say(f"track: interrupted: {len(found.time_s)} frames are written")
    return INTERRUPTED if stop() else 0
