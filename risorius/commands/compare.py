"""`risorius compare`: a decoded video beside its source."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from risorius.command_line.parser import add_command
from risorius.command_line.progress import ProgressLine, say, warn

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands


def add_compare(added: "Commands") -> None:
    """`risorius compare`."""
    parser = add_command(
        added,
        "compare",
        "measure a decoded video against its source",
        "Any two videos of one size and as many frames can be compared, other codecs' too.\n"
        "Face and person are found in the source by a judge that the encoder does not use, where\n"
        "`make judge` has installed one, else by the encoder's own networks; it says by which.",
        "  risorius compare me.mp4 decoded.mkv --call call.rzo\n"
        "  risorius compare me.mp4 other_codec.mp4 --json > figures.json\n",
    )
    parser.add_argument("source", metavar="SOURCE", help="video file or image pattern")
    parser.add_argument("decoded", metavar="DECODED", help="what was decoded of it")
    parser.add_argument("--call", metavar="CALL", help="call file, for its size and rate")
    parser.add_argument("--max-frames", type=int, metavar="N", help="compare the first N frames")
    for name in ("lpips", "dists"):
        parser.add_argument(
            f"--{name}",
            type=Path,
            metavar="ONNX",
            help=f"measure {name.upper()} by this network: two pictures in, one number out",
        )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(run=run_compare)


def run_compare(arguments: argparse.Namespace) -> int:
    """`risorius compare`."""
    from loopback.judge.comparison import compare, observe_source
    from loopback.judge.observer import find_observer
    from loopback.report import json_text

    named = {"lpips": arguments.lpips, "dists": arguments.dists}
    networks = {name: path for name, path in named.items() if path is not None}
    observer = find_observer()
    say(f"compare: the judge is {observer.name}")
    view = observe_source(arguments.source, observer, arguments.max_frames)
    with ProgressLine("compare", sys.stderr) as progress:
        compared = compare(
            view,
            arguments.decoded,
            observer,
            progress,
            lambda line: warn([line]),
            with_voice=True,
            with_vmaf=True,
            networks=networks,
        )
    figures = {**compared.figures(), **_call_figures(arguments.call)}
    print(json_text(figures) if arguments.json else _table(figures))
    return 0


def _call_figures(call: str | None) -> dict[str, Any]:
    """What a call file weighs."""
    if call is None:
        return {}
    from loopback.report import rounded
    from protocol.summary import summarise

    summary = summarise(Path(call))
    size = Path(call).stat().st_size
    return {
        "call_bytes": size,
        "model_bytes": summary.model_bytes,
        "frame_bps": rounded(summary.frame_bps, 1),
    }


def _table(figures: dict[str, Any]) -> str:
    from loopback.figures import FIGURES
    from loopback.report import table

    rows = [
        [each.label, figures[each.name]]
        for each in FIGURES
        if each.label and figures.get(each.name) is not None
    ]
    return table((f"{figures['frames']} frames, judge: {figures['judge']}", ""), rows)
