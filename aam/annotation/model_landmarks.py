"""The landmarks of the largest face in a still picture, by a trained model and no network."""

import numpy as np

from aam.model import MultiResolutionModel
from aam.search.face_finder import FaceFinder, on_network_landmarks
from shared_model.arrays import Array, Picture


class ModelLandmarks:
    """Finds landmarks in pictures by a model that `risorius train` made."""

    def __init__(self, model: MultiResolutionModel) -> None:
        self._model, self._finder = model, FaceFinder(model)

    def find(self, picture: Picture) -> Array | None:
        """(468, 3) pixels, nan where the model has no landmark, and for depth; None: no face.

        picture: (h, w, 3) uint8 BGR.
        """
        fit = self._finder.find(picture)
        if fit is None:
            return None
        points = on_network_landmarks(self._model, fit)
        points[:, 2] = np.nan
        return points
