"""A model by its name: the one that comes along, or a file."""

from importlib.resources import as_file, files
from pathlib import Path

from aam.model import MultiResolutionModel
from aam.model_file import read_model

# Trained on drawn faces, see data/README.md.
BUILTIN = "builtin"
BUILTIN_FILE = "drawn_faces.npz"


def named_model(name: str | Path) -> MultiResolutionModel:
    """The model `BUILTIN`, or that of a file.  Raises `UserError` if it cannot be read."""
    if str(name) != BUILTIN:
        return read_model(Path(name))
    with as_file(files("aam") / "data" / BUILTIN_FILE) as path:
        return read_model(path)
