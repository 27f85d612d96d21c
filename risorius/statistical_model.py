"""The statistical model that finds landmarks where an encoder shall use no network: `--aam`."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from encoder.fitting.landmark_source import LandmarkSource


def landmark_source(model: str | Path | None) -> "LandmarkSource | None":
    """What finds landmarks by a model of `risorius train`; None: none is asked for.

    Raises `UserError` if the file cannot be read or is no model.
    """
    if model is None:
        return None
    from aam.model_file import read_model
    from aam.search.landmark_tracker import ModelLandmarkTracker

    return ModelLandmarkTracker(read_model(Path(model)))
