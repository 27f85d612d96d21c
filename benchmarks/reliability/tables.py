"""The tables of docs/reliability.md: one line a row of measurement, under the name of its clip."""

import statistics
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any

from benchmarks.reliability.figures import percentile
from loopback.report import Cell, markdown_line

COLUMNS = (
    *("link", "up s", "first s", "dB", "lost", "came %", "median", "p95"),
    *("back s", "step", "forward", "back"),
)


def cells_of(name: str, calls: Sequence[dict[str, Any]]) -> list[Cell]:
    """The row of a table from the figures of its calls, see `__main__`."""

    def worst(figure: str, digits: int = 0) -> Cell:
        values = [call[figure] for call in calls if call[figure] is not None]
        return f"{max(values):.{digits}f}" if values else None

    def mean(figure: str, digits: int = 0) -> Cell:
        values = [call[figure] for call in calls if call[figure] is not None]
        return f"{statistics.mean(values):.{digits}f}" if values else None

    ways = [way for call in calls for way in call["ways_ms"] or ()]

    def way(share: float) -> Cell:
        return f"{percentile(ways, share):.0f}" if ways else None

    return [
        name,
        worst("up_s", 1),
        worst("first_s", 1),
        mean("change_db", 2),
        mean("lost", 1),
        f"{100 - 100 * ways.count(None) / len(ways):.1f}" if ways else None,
        way(0.5),
        way(0.95),
        worst("back_s", 1),
        worst("step", 2),
        mean("forward_bps"),
        mean("back_bps"),
    ]


def markdown_lines(rows: Sequence[Sequence[Cell]]) -> dict[str, str]:
    """A line of a Markdown table for each row, by the row's name; None is a dash."""
    return {str(row[0]): markdown_line(map(_text, row)) for row in rows}


def replaced(text: str, clip: str, lines: Mapping[str, str]) -> str:
    """The page with these lines in the table of a clip: each instead of that of its name, what is
    new below the others.

    Raises `ValueError` if the page has no table of the clip.
    """
    page = text.split("\n")
    heads = [i for i, line in enumerate(page) if line.startswith(f"{clip} (")]
    if not heads:
        raise ValueError(f"there is no table of {clip}")
    begin = next(i for i in range(heads[0], len(page)) if page[i].startswith("|"))
    known = list(takewhile(lambda line: line.startswith("|"), page[begin:]))
    names = [line.split("|")[1].strip() for line in known]
    table = [lines.get(name, line) for name, line in zip(names, known, strict=True)]
    table += [line for name, line in lines.items() if name not in names]
    return "\n".join([*page[:begin], *table, *page[begin + len(known) :]])


def _text(cell: Cell) -> str:
    return "-" if cell is None else str(cell)
