"""Frames from numbered image files."""

import os
import re
from pathlib import Path

import cv2
import numpy as np

from shared_model.arrays import Picture
from shared_model.errors import UserError

_NUMBER_FIELD = re.compile(r"%0?\d*d")
_RATE = re.compile(r"(?P<pattern>.*%0?\d*d.*)@(?P<rate>\d+(?:\.\d+)?(?:/\d+)?)")


def pattern_and_rate(source: str) -> tuple[str, str | None]:
    """A pattern such as frame_%04d.png@30, divided where its rate begins; None: it has none."""
    match = _RATE.fullmatch(source)
    return (source, None) if match is None else (match["pattern"], match["rate"])


class ImageSequence:
    """Reads the images of a pattern such as frame_%04d.png, the lowest number first.

    frame_count: their number.  Raises `UserError` if there are none or one is missing.
    """

    def __init__(self, pattern: Path) -> None:
        paths = sequence_paths(pattern)
        self.frame_count, self._paths = len(paths), iter(paths)

    @property
    def notes(self) -> list[str]:
        """See `Reader`: there are none."""
        return []

    def read(self) -> Picture | None:
        """The next picture (h, w, 3) uint8 BGR; None after the last.  Raises `UserError`."""
        path = next(self._paths, None)
        if path is None:
            return None
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise UserError(f"{path} is not a readable image")
        return np.asarray(image, dtype=np.uint8)

    def close(self) -> None:
        """Nothing stays open."""


def sequence_paths(pattern: Path) -> list[Path]:
    """The files of a pattern in the order of their numbers.  Raises `UserError`."""
    fields = _NUMBER_FIELD.findall(pattern.name)
    if len(fields) != 1 or pattern.name.count("%") != 1:
        raise UserError(f"{pattern}: a sequence pattern has one number, such as frame_%04d.png")
    before, after = pattern.name.split(fields[0])
    shape = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    matches = map(shape.fullmatch, os.listdir(pattern.parent) if pattern.parent.is_dir() else [])
    numbers = sorted({int(m[1]) for m in matches if m and pattern.name % int(m[1]) == m[0]})
    if not numbers:
        raise UserError(f"{pattern}: no file matches this pattern")
    for expected, number in enumerate(numbers, start=numbers[0]):
        if number != expected:
            raise UserError(
                f"{pattern.parent / (pattern.name % expected)} is missing in the sequence"
            )
    return [pattern.parent / (pattern.name % number) for number in numbers]
