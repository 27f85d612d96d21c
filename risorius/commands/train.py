"""`risorius train`: a statistical model of many faces, from annotations."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.argument_types import share
from risorius.command_line.output_checks import check_output_folder, check_outputs
from risorius.command_line.parser import add_command
from risorius.command_line.progress import ProgressLine, say
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands

# Steps of the progress.
STEPS = 100
DESCRIPTION = """\
Trains shape, texture and combined modes and the matrices by which a search steps, on what
`risorius annotate` wrote, and a report with pictures.  The same annotations, options and seed give
the same bytes.  docs/aam.md describes the model and its file."""
EXAMPLES = """\
  risorius train annotated -o model.npz --report model
  risorius train imm ytf -o model.npz --size 64 --retained 0.97
"""


def add_train(added: "Commands") -> None:
    """`risorius train`."""
    parser = add_command(
        added, "train", "train a model of many faces from annotations", DESCRIPTION, EXAMPLES
    )
    parser.add_argument(
        "folders", nargs="+", type=Path, metavar="DIR", help="folders that `annotate` wrote"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="NPZ", help="file for the model"
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="folder for the report, index.html: modes, their variance, a search step by step",
    )
    _add_model_options(parser)
    parser.add_argument("--seed", type=int, default=1, help="of what is drawn (default: 1)")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    parser.set_defaults(run=run_train)


def _add_model_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--size",
        type=int,
        default=128,
        choices=(64, 128, 256),
        help="texels a side of the finest level (default: 128)",
    )
    parser.add_argument(
        "--frame",
        default="full",
        choices=("full", "inside"),
        help="texels of the whole face, or of what moves inside of it (default: full)",
    )
    parser.add_argument(
        "--retained",
        type=share,
        default=0.92,
        metavar="SHARE",
        help="of the variance that the modes keep (default: 0.92)",
    )
    parser.add_argument(
        "--discard",
        type=int,
        default=0,
        metavar="N",
        help="leave out the first N combined modes (default: 0)",
    )
    parser.add_argument(
        "--discard-texture",
        type=int,
        default=0,
        metavar="N",
        help="leave out the first N modes of the texture (default: 0)",
    )
    parser.add_argument(
        "--normalise",
        default="retinex",
        choices=("retinex", "none"),
        help="of the light: retinex and histogram equalisation, or none (default: retinex)",
    )
    parser.add_argument(
        "--compact",
        action="store_true",
        help="write textures and matrices in half precision, compressed: about a fifth of the size",
    )
    parser.add_argument(
        "--no-mirror", action="store_true", help="do not train on mirror images as well"
    )


def run_train(arguments: argparse.Namespace) -> int:
    """`risorius train`: nothing is written if it is stopped."""
    check_outputs(arguments.folders, [arguments.output])
    check_output_folder(arguments.report)
    from aam.model_file import write_model
    from aam.training.faces import read_faces
    from aam.training.report import write_report
    from aam.training.train import TrainingOptions, train

    if min(arguments.discard, arguments.discard_texture, arguments.seed) < 0:
        raise UserError("--discard, --discard-texture and --seed take 0 or more")
    options = TrainingOptions(
        size=arguments.size,
        frame=arguments.frame,
        retained=arguments.retained,
        discard=arguments.discard,
        discard_texture=arguments.discard_texture,
        normalisation=arguments.normalise,
        mirror=not arguments.no_mirror,
        seed=arguments.seed,
    )
    faces = read_faces(arguments.folders)
    progress_line = ProgressLine("train", sys.stderr, arguments.quiet)
    with StopOnSignal(), progress_line as progress:
        try:
            model = train(faces, options, lambda done: progress(round(STEPS * done), STEPS))
        except ValueError as error:
            raise UserError(str(error)) from error
        write_model(arguments.output, model, arguments.compact)
        page = arguments.report and write_report(arguments.report, model, faces, options)
    finest = model.levels[-1]
    counts = (len(each.variances) for each in (finest.shape, finest.texture, finest.combined))
    modes = "{} shape, {} texture, {} combined modes".format(*counts)
    say(f"{len(faces)} faces: {modes}" + (f"; look at {page}" if page else ""))
    return 0
