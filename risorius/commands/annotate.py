"""`risorius annotate`: the 3D model fitted to still pictures, for training an AAM."""

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, say, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError, cannot_write

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

DESCRIPTION = """\
Writes pose, shape (AAUs and EAUs) and shape-free texture of each picture as NAME.json and NAME.npz,
and contact sheets to look at, the worst fits first.  What is there already is not fitted again.
docs/aam.md describes the files."""
EXAMPLES = """\
  risorius annotate faces/ -o annotated --person '(s[0-9]+)/'
  risorius annotate *.jpg -o annotated --landmarks .asf
"""


def add_annotate(added: "Commands") -> None:
    """`risorius annotate`."""
    parser = add_command(
        added,
        "annotate",
        "fit the 3D model to still pictures",
        DESCRIPTION,
        EXAMPLES,
    )
    parser.add_argument(
        "images", nargs="+", type=Path, metavar="IMAGES", help="pictures, or folders of them"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the annotations"
    )
    parser.add_argument(
        "--landmarks",
        default="network",
        metavar="WHERE",
        help="network: found by the landmark network (default); .asf or .pts: a file beside each"
        " picture; FILE.csv: a line NAME,x0,y0,x1,y1,... for each; 68, 73 or 468 points;"
        " MODEL.npz: found by a trained model from Viola-Jones' eyes, without a network; builtin:"
        " by the one that comes along",
    )
    parser.add_argument(
        "--perspective",
        action="store_true",
        help="full perspective with a typical lens instead of weak perspective",
    )
    parser.add_argument(
        "--residual", action="store_true", help="fit the residual shape beside AAUs and EAUs"
    )
    parser.add_argument(
        "--eaus",
        choices=("all", "thesis"),
        default="all",
        help="which actuators are fitted: all but the gaze (default), or the four of the thesis'"
        " tracking model, the others at rest",
    )
    parser.add_argument(
        "--person",
        default="",
        metavar="REGEX",
        help="its first group in a picture's path says whom it shows (default: all differ)",
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    parser.set_defaults(run=run_annotate)


def run_annotate(arguments: argparse.Namespace) -> int:
    """`risorius annotate`: what is annotated when it is stopped stays."""
    from aam.annotation.annotate import AnnotationOptions, annotate, list_images
    from aam.annotation.contact_sheet import write_contact_sheets

    _check_pattern(arguments.person)
    projection = "perspective" if arguments.perspective else "weak"
    options = AnnotationOptions(
        projection, arguments.residual, arguments.landmarks, arguments.person, arguments.eaus
    )
    images, folder = list_images(arguments.images), arguments.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    progress_line = ProgressLine("annotate", sys.stderr, arguments.quiet)
    with StopOnSignal() as stop, progress_line as progress:
        report = annotate(images, folder, options, stop.watch(progress), stop)
        sheets = write_contact_sheets(folder, report.names)
    warn(report.failures)
    if not report.names:
        raise UserError(f"none of {len(images)} pictures was annotated", report.exit_code)
    known = len(report.names) - report.fitted
    say(f"{report.fitted} annotated, {known} were so before; look at {sheets[0]}")
    return INTERRUPTED if stop() else report.exit_code


def _check_pattern(pattern: str) -> None:
    try:
        groups = re.compile(pattern).groups
    except re.error as error:
        raise UserError(f"--person {pattern}: {error}") from error
    if pattern and not groups:
        raise UserError(f"--person {pattern} has no group; put the name between ( and )")
