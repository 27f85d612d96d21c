"""`risorius animate` and `risorius view`: the head moved by a script, and by hand."""

import argparse
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.argument_types import port
from risorius.command_line.output_checks import check_outputs
from risorius.command_line.parser import INTERRUPTED, add_command
from risorius.command_line.progress import ProgressLine, warn
from risorius.command_line.signals import StopOnSignal
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_animate(added: "Commands") -> None:
    """`risorius animate`."""
    parser = add_command(
        added,
        "animate",
        "draw an animation script and write down the truth of it",
        "The script is a TOML file of key frames (docs/animate.md; four in examples/animations).\n"
        "Next to the video a JSON file says where everything was in every picture.",
        "  risorius animate examples/animations/talking.toml -o talking.mkv\n"
        "  risorius animate examples/animations/emotions.toml --call anna.rzo -o anna.mp4\n",
    )
    parser.add_argument("script", type=Path, metavar="SCRIPT", help="animation script (.toml)")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="video or image pattern"
    )
    parser.add_argument(
        "--call", type=Path, metavar="CALL", help="animate the person of this call file"
    )
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="the truth's JSON (default: next to the output)"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress, no summary")
    parser.set_defaults(run=run_animate)


def add_view(added: "Commands") -> None:
    """`risorius view`."""
    parser = add_command(
        added,
        "view",
        "move every actuator of the face by hand, or correct annotations, in a browser",
        "Prints the address of a page on this host: a slider for each actuator or, left and\n"
        "right apart, for each muscle, a face to drag, the decoder's own renderer behind it;\n"
        "Blink lets it blink by itself.  Ctrl-C ends it.  Single pictures come from\n"
        "ADDRESS/picture.jpg?jaw_drop=0.5&happiness=1&yaw=-20, names as in docs/animate.md.\n"
        "With --annotation the page shows what `risorius annotate` wrote: drag a landmark, move a\n"
        "slider, and the rest is fitted again; saved over it, the fit without a hand beside it.",
        "  risorius view\n  risorius view --call anna.rzo --port 8000\n"
        "  risorius view --annotation annotated --model model.npz\n",
    )
    whom = parser.add_mutually_exclusive_group()
    whom.add_argument("--call", type=Path, metavar="CALL", help="show the person of this call file")
    whom.add_argument(
        "--annotation",
        type=Path,
        metavar="PATH",
        help="correct the annotations of this folder, or of this JSON file",
    )
    parser.add_argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="look here for annotated pictures that are not where they were",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="MODEL.npz",
        help="show what is left of an annotated texture by this model of `risorius train`",
    )
    parser.add_argument(
        "--port", type=port, default=0, metavar="N", help="TCP port; 0: any free one (default: 0)"
    )
    parser.set_defaults(run=run_view)


def run_animate(arguments: argparse.Namespace) -> int:
    """`risorius animate`."""
    check_outputs([arguments.script, arguments.call], [arguments.output, arguments.truth])
    from risorius.animation.animate import animate

    files = arguments.script, arguments.output
    with StopOnSignal() as stop, ProgressLine("animate", sys.stderr, arguments.quiet) as progress:
        report = animate(*files, stop.watch(progress), stop, arguments.call, arguments.truth)
    if report.unused:
        names = " ".join(report.unused)
        warn([f"{arguments.script}: with --call these are without effect: {names}"])
    if not arguments.quiet:
        done = "interrupted: " if stop() else ""
        print(f"{done}{report.frames} pictures in {report.output}, the truth in {report.truth}")
    return INTERRUPTED if stop() else 0


def run_view(arguments: argparse.Namespace) -> int:
    """`risorius view`: being stopped is its normal end."""
    if arguments.annotation is not None:
        return _view_annotations(arguments)
    for name in ("pictures", "model"):
        if getattr(arguments, name) is not None:
            raise UserError(f"--{name} is for annotations; name them by --annotation")
    from risorius.view.server import view

    with StopOnSignal(), suppress(KeyboardInterrupt):
        view(arguments.call, arguments.port, lambda url: print(url, flush=True))
    return 0


def _view_annotations(arguments: argparse.Namespace) -> int:
    from risorius.view.annotation_server import view_annotations

    shown = arguments.annotation, arguments.pictures, arguments.model, arguments.port
    with StopOnSignal(), suppress(KeyboardInterrupt):
        view_annotations(*shown, lambda url: print(url, flush=True))
    return 0
