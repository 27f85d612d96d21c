"""The statistical model that finds faces where an encoder shall use no network: `--aam`."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from encoder.fitting.expression_search import ExpressionSearch
    from encoder.fitting.landmark_source import LandmarkSource


def landmark_source(
    model: str | Path | None, nose: Path | None = None, every_frame: bool = False
) -> "LandmarkSource | None":
    """What finds landmarks by a model; None: none is asked for.

    model: see `named_model`.  nose: see `HaarDetector`.  every_frame: see `LandmarkSource`.
    Raises `UserError` if the file cannot be read or is no model.
    """
    if model is None:
        return None
    from aam.model_file import named_model
    from aam.search.landmark_tracker import ModelLandmarkTracker

    return ModelLandmarkTracker(named_model(model), nose, every_frame)


def expression_search(model: str | Path | None) -> "ExpressionSearch | None":
    """What measures actuators by a model's parameters c; None: none is asked for.

    model: see `named_model`.  Raises `UserError` if the file cannot be read or is no model.
    """
    if model is None:
        return None
    from aam.model_file import named_model
    from aam.search.landmark_tracker import ModelExpressionSearch

    return ModelExpressionSearch(named_model(model))
