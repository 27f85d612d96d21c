"""The landmarks of the largest face in a still picture, by a trained model and no network.

Viola-Jones finds the eyes of each candidate (thesis 5.1), the model is searched from them (3.1),
and a candidate whose texture it cannot explain is no face.
"""

import cv2
import numpy as np

from aam.model import MultiResolutionModel
from aam.search.find_face import FaceFit, find_from_eyes, is_explained
from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.detection.viola_jones import HaarDetector
from shared_model.arrays import Array, Picture

# Margin, of the longer side, that is added where no face is found: detectors miss faces that fill
# the picture.
MARGIN = 0.25


class ModelLandmarks:
    """Finds landmarks in pictures by a model that `risorius train` made."""

    def __init__(self, model: MultiResolutionModel) -> None:
        self._model, self._detector = model, HaarDetector()

    def find(self, picture: Picture) -> Array | None:
        """(468, 3) pixels, nan where the model has no landmark, and for depth; None: no face.

        picture: (h, w, 3) uint8 BGR.
        """
        for margin in (0, round(MARGIN * max(picture.shape[:2]))):
            wide = cv2.copyMakeBorder(picture, *(margin,) * 4, cv2.BORDER_REPLICATE)
            found = self._find(np.asarray(wide, np.uint8))
            if found is not None:
                return np.asarray(found - [margin, margin, 0])
        return None

    def _find(self, picture: Picture) -> Array | None:
        for candidate in self._detector.detect(picture):
            fit = find_from_eyes(self._model, picture, candidate.keypoints[:2])
            if is_explained(self._model, fit):
                return on_network_landmarks(self._model, fit)
        return None


def on_network_landmarks(model: MultiResolutionModel, fit: FaceFit) -> Array:
    """(468, 3) the landmarks of a fit in the order of the network; nan: none, and for depth."""
    points = np.full((LANDMARK_COUNT, 3), np.nan)
    points[model.warp(len(model.levels) - 1).landmark_index, :2] = fit.landmarks
    return points
