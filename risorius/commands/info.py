"""`risorius info`: what a call file weighs, part by part."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from risorius.command_line.output_checks import STANDARD
from risorius.command_line.parser import add_command
from risorius.command_line.progress import warn
from shared_model.errors import UserError

if TYPE_CHECKING:
    from protocol.summary import CallSummary
    from risorius.command_line.parser import Commands

SPLIT = ("groups", "group_bits")


def add_info(added: "Commands") -> None:
    """`risorius info`."""
    parser = add_command(
        added,
        "info",
        "say what is in a call file",
        "The bytes of its parts add up to the file's.",
        "  risorius info call.rzo\n  risorius info call.rzo --json | jq .frame_bps\n",
    )
    parser.add_argument("call_file", type=Path, metavar="CALL", help="call file (.rzo)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_info)


def run_info(arguments: argparse.Namespace) -> int:
    """`risorius info`."""
    from loopback.report import json_text
    from risorius.call_info import call_info

    path: Path = arguments.call_file
    if path == STANDARD and not path.exists():
        raise UserError("info does not read standard input; give the name of a call file")
    summary = call_info(path)
    if not summary.complete:
        reason = "damaged" if summary.damaged_packets else "cut off"
        warn([f"{path} is {reason}: these are the figures of what is there"])
    if summary.damaged_packets:
        warn([f"damaged packets, left out: {summary.damaged_packets}"])
    if summary.trailing_bytes:
        warn([f"{summary.trailing_bytes} bytes after the end of the call are left out"])
    if arguments.json:
        print(json_text(summary))
        return 0
    print(summary_table(summary))
    return 0


def summary_table(summary: "CallSummary") -> str:
    """The figures of a call, and how the groups of parameters share the frame packets' bytes."""
    from loopback.report import Cell, flatten, table

    figures = {name: value for name, value in asdict(summary).items() if name not in SPLIT}
    rows = [[name.replace("_", " ").replace(".", " "), value] for name, value in flatten(figures)]
    groups: list[list[Cell]] = [
        [name, count, summary.group_bits[name], 100 * count / max(summary.frame_bytes, 1)]
        for name, count in summary.groups.items()
    ]
    header = ("groups", "bytes", "group bits a frame", "% of frame bytes")
    return f"{table(('what', 'value'), rows)}\n\n{table(header, groups)}"
