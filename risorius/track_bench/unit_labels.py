"""Action units that people have coded: files of DISFA, CK+, MMI, and tables as of OpenFace.

DISFA (Mavadati et al. 2013): `SN001_au12.txt`, a line "frame,intensity" for each frame, 0 to 5.
CK+ (Lucey et al. 2010): `S005_001_00000011_facs.txt`, a line "unit intensity" for each unit of the
sequence's last frame; its first frame is neutral.
MMI (Pantic et al. 2005): `S001-001-oao_aucs.xml`, an `ActionUnit` with `Marker`s, at whose `Frame`
a phase begins: `Type` 0 neutral, 1 onset, 2 apex, 3 offset.
Tables: `NAME.csv` with columns `AU12_c` (0 or 1), `AU12_r` (0 to 5) or `AU12` (above 0: shown) and,
if it has one, `frame`, the first one 1.
"""

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from risorius.track_bench.truth_files import files_below, matching_key
from shared_model.arrays import Mask
from shared_model.errors import UserError

# Intensities from which a unit counts as shown: DISFA's as papers count them, OpenFace's its own.
DISFA_SHOWN, OPENFACE_SHOWN = 2.0, 1.0
_DISFA = re.compile(r"(?P<key>.+)_au(?P<unit>\d+)\.txt", re.IGNORECASE)
_CK = re.compile(r"(?P<key>.+)_(?P<frame>\d+)_facs\.txt")
_MMI = re.compile(r"(?P<key>.+?)(-oao)?[-_]aucs\.xml|(?P<other>.+?)-oao\.xml")
_COLUMN = re.compile(r"AU0*(?P<unit>\d+)(?P<kind>_[cr])?")


@dataclass(frozen=True, slots=True, eq=False)
class UnitLabels:
    """frames: (k,) numbers of the frames that were coded, the first frame is 0.

    shown: unit such as "AU12" -> (k,) whether it is shown there.
    is_complete: all units were coded; those that are not in `shown` are not shown.
    """

    frames: NDArray[np.intp]
    shown: Mapping[str, Mask]
    is_complete: bool = False


# The labels of the files of one recording.  Raises OSError, ValueError or `ElementTree.ParseError`.
Reader = Callable[[Sequence[Path]], UnitLabels]


def find_unit_labels(place: Path, source: str) -> UnitLabels:
    """The labels of a source, by its name, in a folder or file.

    Raises `UserError` if there are none, or if a file of them cannot be read.
    """
    known: dict[str, tuple[Reader, list[Path]]] = {}
    for pattern, name, read in KINDS:
        for path in files_below(place, pattern):
            match = None if name is None else name.fullmatch(path.name)
            if name is not None and match is None:
                continue
            key = path.stem if match is None else next(filter(None, match.groups()))
            known.setdefault(key, (read, []))[1].append(path)
    key = next(iter(known), None) if place.is_file() else matching_key(source, known)
    if key is None:
        raise UserError(f"{place}: no action units of {source}, see docs/tracker.md for the files")
    read, paths = known[key]
    try:
        return read(paths)
    except (OSError, ValueError, KeyError, ElementTree.ParseError) as error:
        raise UserError(f"{paths[0]}: not labels of action units: {error}") from error


def read_disfa(paths: Sequence[Path]) -> UnitLabels:
    """The files of all units of one recording.  Raises ValueError."""
    shown, frames = dict[str, Mask](), np.zeros(0, dtype=np.intp)
    for path in paths:
        match = _DISFA.fullmatch(path.name)
        values = np.loadtxt(path, delimiter=",", ndmin=2)
        if match is None or values.shape[1] != 2 or (len(frames) and len(frames) != len(values)):
            raise ValueError(f"{path.name} has shape {values.shape}, expected frame, intensity")
        frames = values[:, 0].astype(np.intp) - 1
        shown[f"AU{int(match['unit'])}"] = values[:, 1] >= DISFA_SHOWN
    return UnitLabels(frames, shown)


def read_ck(paths: Sequence[Path]) -> UnitLabels:
    """The file of one sequence: its last frame, and the first, which is neutral."""
    match = _CK.fullmatch(paths[0].name)
    rows = [line.split() for line in paths[0].read_text(encoding="utf-8").splitlines()]
    units = {f"AU{int(float(row[0]))}" for row in rows if row}
    last = int(match["frame"]) - 1 if match else 0
    shown = {unit: np.array([False, True]) for unit in sorted(units)}
    return UnitLabels(np.array([0, last]), shown, is_complete=True)


def read_mmi(paths: Sequence[Path]) -> UnitLabels:
    """The file of one session: every frame up to the last marker.  Raises ValueError."""
    phases = list[tuple[str, list[tuple[int, int]]]]()
    for each in ElementTree.parse(paths[0]).getroot().iter("ActionUnit"):
        number = re.search(r"\d+", each.get("Number", ""))
        marks = [(int(m.get("Frame", 0)), int(m.get("Type", 0))) for m in each.iter("Marker")]
        if number is not None and marks:
            phases.append((f"AU{int(number[0])}", sorted(marks)))
    if not phases:
        raise ValueError("no ActionUnit with a Marker")
    count = max(marks[-1][0] for _, marks in phases)
    shown: dict[str, Mask] = {}
    for unit, marks in phases:
        mask = shown.setdefault(unit, np.zeros(count, dtype=np.bool_))
        ends = [frame for frame, _ in marks[1:]] + [count + 1]
        for (frame, phase), end in zip(marks, ends, strict=True):
            # A unit of either side counts.
            mask[frame - 1 : end - 1] |= phase != 0
    return UnitLabels(np.arange(count), shown, is_complete=True)


def read_table(paths: Sequence[Path]) -> UnitLabels:
    """A CSV file; a unit's `_c` column counts, else its `_r` column, else its own."""
    with paths[0].open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file, skipinitialspace=True)
        rows = [{(k or "").strip(): v for k, v in row.items()} for row in table]
    if not rows:
        raise ValueError("no line below the names of the columns")
    columns: dict[str, tuple[str, str]] = {}
    for name in rows[0]:
        match = _COLUMN.fullmatch(name)
        if match is not None:
            unit, kind = f"AU{int(match['unit'])}", match["kind"] or ""
            if unit not in columns or kind == "_c":
                columns[unit] = name, kind
    if not columns:
        raise ValueError("no column of an action unit, such as AU12_c")
    least = {"_c": 0.5, "_r": OPENFACE_SHOWN, "": 1e-9}
    frames = [int(float(row["frame"])) - 1 if "frame" in row else i for i, row in enumerate(rows)]
    shown = {
        unit: np.array([float(row[name] or 0) >= least[kind] for row in rows])
        for unit, (name, kind) in columns.items()
    }
    return UnitLabels(np.array(frames, dtype=np.intp), shown)


# Glob pattern of a kind's files, how their names are divided, and what reads a recording's.
KINDS: tuple[tuple[str, re.Pattern[str] | None, Reader], ...] = (
    ("*.csv", None, read_table),
    ("*.xml", _MMI, read_mmi),
    ("*_facs.txt", _CK, read_ck),
    ("*_[aA][uU]*.txt", _DISFA, read_disfa),
)
