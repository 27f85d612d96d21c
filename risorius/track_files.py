"""What `risorius track` writes: CSV, the CSV of OpenFace, JSON.

Columns: the numbers of all frames by name, see `FaceTrack.columns`; nan where there is no face.
"""

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from shared_model.arrays import Array

Columns = Mapping[str, Array]

DIGITS = 4
# A face that is followed with less confidence has not been found, as OpenFace counts.
SUCCESS = 0.5
# Intensities of OpenFace end here; a unit is there from its presence on.
OPENFACE_RANGE, OPENFACE_PRESENT = 5.0, 1.0


def csv_text(columns: Columns) -> str:
    """A line for each frame; cells of a frame without a face are empty."""
    return _table(columns, {name: [_cell(v) for v in each] for name, each in columns.items()})


def openface_csv_text(columns: Columns) -> str:
    """The columns of OpenFace 2: pose in mm and radians, units AUnn_r on 0..5, AUnn_c 0 or 1.

    Rotations are right-handed about the camera's axes, x to the right, y down, z away: `pose_Rx`
    > 0 looks down, `pose_Ry` > 0 turns to the subject's right, `pose_Rz` > 0 tilts to their left.
    Without a face all is 0.
    """
    there = np.isfinite(columns["pitch_deg"])
    success = there & (columns["confidence"] >= SUCCESS)
    units = {f"AU{int(n[2:]):02d}": each for n, each in columns.items() if n.startswith("AU")}
    whole = {
        "frame": np.arange(1, len(there) + 1),
        "face_id": np.zeros(len(there)),
        "success": success,
    } | {f"{n}_c": OPENFACE_RANGE * each >= OPENFACE_PRESENT for n, each in units.items()}
    numbers = {"timestamp": columns["time_s"], "confidence": columns["confidence"]}
    numbers |= {f"pose_T{axis}": columns[f"{axis}_mm"] for axis in "xyz"}
    angles = zip("xyz", ("pitch", "yaw", "roll"), strict=True)
    numbers |= {f"pose_R{axis}": -np.radians(columns[f"{n}_deg"]) for axis, n in angles}
    numbers |= {f"{n}_r": OPENFACE_RANGE * each for n, each in units.items()}
    cells = {n: [str(int(v)) for v in each] for n, each in whole.items()}
    cells |= {n: [_cell(v) for v in np.nan_to_num(each)] for n, each in numbers.items()}
    first = ("frame", "face_id", "timestamp", "confidence", "success")
    pose = tuple(n for n in cells if n.startswith("pose"))
    return _table((*first, *pose, *(f"{n}_r" for n in units), *(f"{n}_c" for n in units)), cells)


def json_text(columns: Columns) -> str:
    """The names of the columns, and an object for each frame; null where there is no face."""
    values = {
        name: [float(_cell(v)) if np.isfinite(v) else None for v in each]
        for name, each in columns.items()
    }
    rows = zip(*values.values(), strict=True)
    frames = [dict(zip(values, row, strict=True)) for row in rows]
    return f"{json.dumps({'columns': list(columns), 'frames': frames}, indent=1)}\n"


FORMATS: Mapping[str, Callable[[Columns], str]] = {
    "csv": csv_text,
    "openface": openface_csv_text,
    "json": json_text,
}


def _cell(value: float) -> str:
    """With `DIGITS` decimals, never -0; empty for nan."""
    return "" if np.isnan(value) else f"{round(float(value), DIGITS) + 0.0:.{DIGITS}f}"


def _table(names: Iterable[str], cells: Mapping[str, list[str]]) -> str:
    text, order = io.StringIO(), list(names)
    table = csv.writer(text, lineterminator="\n")
    table.writerow(order)
    table.writerows(zip(*(cells[name] for name in order), strict=True))
    return text.getvalue()
