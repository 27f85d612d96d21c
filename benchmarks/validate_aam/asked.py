"""What is asked of the model, beside what an experiment reached; what a part of them gives."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.validate_aam import tables

ASKED_HEAD = ("", "asked", "reached", "", "part")


@dataclass(frozen=True, slots=True)
class Asked:
    """A line of the table: what is measured, what is asked of it, what was reached, whether that
    is enough.
    """

    what: str
    asked: str
    reached: str
    verdict: str


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """What a part of the experiments gives.

    text: its tables, Markdown.  files: further ones by name.  asked: its lines of the table.
    """

    text: str
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    asked: Sequence[Asked] = ()


def verdict(met: Mapping[str, bool]) -> str:
    """ "reached" or "missed"; which of several are, where only some are reached."""
    if len(set(met.values())) == 1:
        return "reached" if all(met.values()) else "missed"
    reached, missed = (", ".join(n for n, v in met.items() if v is want) for want in (True, False))
    return f"{reached} reached, {missed} missed"


def asked_rows(part: str, asked: Sequence[Asked]) -> str:
    """The lines of the table of what was asked, without its head; empty if there are none."""
    rows = [[each.what, each.asked, each.reached, each.verdict, part] for each in asked]
    return tables.table(ASKED_HEAD, rows).split("\n", 2)[2] if rows else ""


def asked_table(rows: Sequence[str]) -> str:
    """The table of the lines of all parts, see `asked_rows`."""
    return "## Asked and reached\n\n" + tables.table(ASKED_HEAD, []) + "".join(rows)


def joined(values: Iterable[float]) -> str:
    """Numbers as a text: 9, 81, 33."""
    return ", ".join(f"{value:g}" for value in values)
