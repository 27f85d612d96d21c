"""Reports as people and programs read them: JSON files and plain tables."""

import json
import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from shared_model.whole_file import whole_file

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Cell = str | int | float | None

# Characters of a line that a terminal shows.
TERMINAL_WIDTH = 100


def write_json(path: Path, report: "DataclassInstance | Mapping[str, Any]") -> None:
    """Write a dataclass or mapping to `path`.  Raises `UserError` if it cannot."""
    write_report(path, f"{json_text(report)}\n".encode())


def write_report(path: Path, content: bytes) -> None:
    """Write a file whole.  Raises `UserError` if it cannot."""
    with whole_file(path) as file:
        file.write(content)


def json_text(report: "DataclassInstance | Mapping[str, Any]") -> str:
    """A dataclass or mapping as JSON."""
    content = dict(report) if isinstance(report, Mapping) else asdict(report)
    return json.dumps(content, indent=2, allow_nan=False)


def figures_of(report: "DataclassInstance") -> dict[str, Any]:
    """The fields of a dataclass by name, in order; of a dataclass in it, its fields, None: none."""
    parts, figures = _parts(type(report)), dict[str, Any]()
    for item in fields(report):
        value = getattr(report, item.name)
        if item.name not in parts:
            figures[item.name] = value
        elif value is not None:
            figures |= figures_of(value)
    return figures


def figure_names(kind: "type[DataclassInstance]") -> set[str]:
    """The names of all figures that `figures_of` may find in such a dataclass."""
    parts = _parts(kind)
    names = {item.name for item in fields(kind) if item.name not in parts}
    return names.union(*map(figure_names, parts.values()))


def _parts(kind: "type[DataclassInstance]") -> "dict[str, type[DataclassInstance]]":
    """The fields of a dataclass that are dataclasses, or may be."""
    hints = get_type_hints(kind).items()
    kinds = ((name, part) for name, hint in hints for part in (hint, *get_args(hint)))
    return {name: part for name, part in kinds if is_dataclass(part) and isinstance(part, type)}


def flatten(report: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Each figure of a nested report with its dotted name: `latency_ms.p50`."""
    for name, value in report.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def figure(report: Mapping[str, Any], name: str) -> Any:
    """A figure of a nested report by its dotted name.  Raises `KeyError`."""
    return dict(flatten(report))[name]


def rounded(value: float | None, digits: int = 2) -> float | None:
    """A figure for a report; None where there is none, since JSON knows no NaN."""
    return None if value is None or not math.isfinite(value) else round(value, digits)


def table(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Columns that line up: texts to the left, figures to the right; None is a dash.

    A column is of texts if it is the first, or if all its cells are.
    """
    texts = [list(header), *([cell_text(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    columns = range(1, len(header))
    left = {0, *(i for i in columns if rows and all(isinstance(row[i], str) for row in rows))}
    lines = ["  ".join(_aligned(row, widths, left)).rstrip() for row in texts]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def wrapped_table(
    header: Sequence[str], rows: Sequence[Sequence[Cell]], width: int = TERMINAL_WIDTH
) -> str:
    """As `table`, but in parts of at most `width` characters, each with the first column."""
    parts: list[list[int]] = [[0]]
    for column in range(1, len(header)):
        wider = [*parts[-1], column]
        if len(parts[-1]) > 1 and _width(header, rows, wider) > width:
            parts.append([0])
            wider = [0, column]
        parts[-1] = wider
    tables = [table([header[i] for i in p], [[row[i] for i in p] for row in rows]) for p in parts]
    return "\n\n".join(tables)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of Markdown, without a line break at its end."""
    lines = map(markdown_line, (header, *rows))
    return "\n".join([next(lines), "|---" * len(header) + "|", *lines])


def markdown_line(cells: Iterable[object]) -> str:
    """A line of a table of Markdown."""
    return "".join(f"| {cell} " if cell else "| " for cell in map(str, cells)) + "|"


def _width(header: Sequence[str], rows: Sequence[Sequence[Cell]], columns: Sequence[int]) -> int:
    part = table([header[i] for i in columns], [[row[i] for i in columns] for row in rows])
    return len(part.split("\n")[1])


def _aligned(row: Sequence[str], widths: Sequence[int], left: Container[int]) -> Iterator[str]:
    for column, (text, width) in enumerate(zip(row, widths, strict=True)):
        yield text.ljust(width) if column in left else text.rjust(width)


def cell_text(cell: Cell) -> str:
    """A figure as people read it; None is a dash."""
    if cell is None:
        return "-"
    return f"{cell:.2f}" if isinstance(cell, float) else str(cell)
