"""Files of given landmarks: .asf and .pts beside each picture, or one CSV for many."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from shared_model.arrays import Array
from shared_model.errors import UserError, cannot_read

# Columns x and y of a point in an .asf file, which are shares of the picture's width and height.
_ASF_COLUMNS = slice(2, 4)


def read_landmark_file(path: Path, size: tuple[int, int]) -> Array:
    """(m, 2) pixels from an .asf or a .pts file.

    size: (width, height) of the picture.  Raises `UserError`.
    """
    lines = _read_lines(path)
    return _read_asf(path, lines, size) if path.suffix.lower() == ".asf" else _read_pts(path, lines)


def read_landmark_csv(path: Path) -> Mapping[str, Array]:
    """(m, 2) pixels by the name of the picture: a column with the name, then x0, y0, x1, y1, ...

    The first line holds the columns' names.  Raises `UserError`.
    """
    found: dict[str, Array] = {}
    for number, row in enumerate(csv.reader(_read_lines(path))):
        if number == 0 or not row:
            continue
        found[row[0]] = _pairs(row[1:], f"{path}, line {number + 1}")
    if not found:
        raise UserError(f"{path} holds no landmarks: after a line of names, NAME,x0,y0,x1,y1,...")
    return found


def _read_lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise cannot_read(path, error) from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not a text file") from error


def _read_asf(path: Path, lines: list[str], size: tuple[int, int]) -> Array:
    """The lines with at least seven numbers are points."""
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    points = [row[_ASF_COLUMNS] for row in rows if len(row) >= 7]
    if not points:
        raise UserError(f"{path} holds no points; expected the format of .asf files")
    shares = _pairs([value for point in points for value in point], str(path))
    return np.asarray(shares * np.array(size, float) - 0.5)


def _read_pts(path: Path, lines: list[str]) -> Array:
    """`version: 1`, `n_points: m`, `{`, a line for each point, `}`."""
    text = "\n".join(lines)
    if "{" not in text or "}" not in text:
        raise UserError(f"{path} has no points between braces; expected the format of .pts files")
    return _pairs(text.partition("{")[2].partition("}")[0].split(), str(path))


def _pairs(values: list[str], where: str) -> Array:
    try:
        numbers = np.array([float(value) for value in values if value != ""])
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error
    if not len(numbers) or len(numbers) % 2 or not np.isfinite(numbers).all():
        raise UserError(f"{where}: expected pairs of finite numbers x, y")
    return numbers.reshape(-1, 2)
