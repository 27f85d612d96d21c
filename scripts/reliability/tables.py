"""The tables of docs/reliability.md: one line a row of measurement, under the name of its clip."""

from collections.abc import Mapping, Sequence
from itertools import takewhile

from loopback.report import Cell


def markdown_lines(rows: Sequence[Sequence[Cell]]) -> dict[str, str]:
    """A line of a Markdown table for each row, by the row's name; None is a dash."""
    return {str(row[0]): f"| {' | '.join(map(_text, row))} |" for row in rows}


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
