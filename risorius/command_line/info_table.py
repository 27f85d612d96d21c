"""What `risorius info` prints."""

from dataclasses import asdict

from loopback.report import Cell, flatten, table
from protocol.summary import CallSummary

SPLIT = ("groups", "group_bits")


def summary_table(summary: CallSummary) -> str:
    """The figures of a call, and how the groups of parameters share the frame packets' bytes."""
    figures = {name: value for name, value in asdict(summary).items() if name not in SPLIT}
    rows = [[name.replace("_", " ").replace(".", " "), value] for name, value in flatten(figures)]
    groups: list[list[Cell]] = [
        [name, count, summary.group_bits[name], 100 * count / max(summary.frame_bytes, 1)]
        for name, count in summary.groups.items()
    ]
    header = ("groups", "bytes", "group bits a frame", "% of frame bytes")
    return f"{table(('what', 'value'), rows)}\n\n{table(header, groups)}"
