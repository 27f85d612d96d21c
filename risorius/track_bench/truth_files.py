"""Which files of a folder belong to a source."""

from collections.abc import Iterable
from pathlib import Path

from encoder.capture.image_sequence import pattern_and_rate

# A shorter name of a recording is not looked for inside a source's name.
LEAST_PART = 4


def source_names(source: str) -> tuple[str, ...]:
    """What a source may be called: its stem; of an image pattern what stands before the number,
    and its folder: `S005/001/S005_001_%08d.png` is S005_001 or 001.
    """
    path = Path(pattern_and_rate(source)[0])
    if "%" not in path.name:
        return (path.stem,)
    return path.name.split("%")[0].rstrip("_-. "), path.parent.name


def matching_key(source: str, keys: Iterable[str]) -> str | None:
    """The recording that a source shows: the one of the same name, else the longest name within
    the source's, as SN001 is within LeftVideoSN001_comp; None: no recording.
    """
    names, known = source_names(source), sorted(keys, key=lambda key: (-len(key), key))
    for key in known:
        if key in names:
            return key
    parts = [key for key in known if len(key) >= LEAST_PART]
    return next((key for key in parts if any(key in name for name in names)), None)


def files_below(place: Path, pattern: str) -> list[Path]:
    """The files of a glob pattern in a folder and its folders, in order.

    place: the folder, or one file of that pattern.
    """
    if place.is_file():
        return [place] if place.match(pattern) else []
    return sorted(place.rglob(pattern))
