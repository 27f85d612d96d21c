"""The largest face in a picture, found by a trained model and no network.

Viola-Jones finds the eyes of each candidate (thesis 5.1), the model is searched from poses about
them and from that of eyes and nose (WP3P), and a candidate whose texture it cannot explain is no
face.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from aam.model import MultiResolutionModel
from aam.search.find_face import FaceFit, find_from_eyes, is_explained
from aam.weak_pose import pose_vector_at
from encoder.detection.detector import Detection
from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.detection.viola_jones import HaarDetector
from encoder.fitting.identity import generic_identity
from encoder.fitting.pose_initialisation import pose_from_three_points
from shared_model.arrays import Array, Picture
from shared_model.mesh import generic_head

# Margin, of the longer side, that is added where no face is found: detectors miss faces that fill
# the picture.
MARGIN = 0.25


class FaceFinder:
    """Finds faces in pictures by a model that `risorius train` made.

    nose: see `HaarDetector`.
    face_count: of the candidates in the newest picture.
    """

    def __init__(self, model: MultiResolutionModel, nose: Path | None = None) -> None:
        self._model, self._detector = model, HaarDetector(nose)
        self.face_count = 0

    def find(self, picture: Picture) -> FaceFit | None:
        """The model in the largest face of a picture (h, w, 3) uint8 BGR; None: no face."""
        for margin in (0, round(MARGIN * max(picture.shape[:2]))):
            wide = cv2.copyMakeBorder(picture, *(margin,) * 4, cv2.BORDER_REPLICATE)
            found = self._find(np.asarray(wide, np.uint8))
            if found is not None:
                pose = found.pose - [0, 0, 0, margin, margin, 0]
                return replace(found, pose=pose, landmarks=found.landmarks - margin)
        return None

    def _find(self, picture: Picture) -> FaceFit | None:
        candidates = self._detector.detect(picture)
        self.face_count = len(candidates)
        for candidate in candidates:
            start = _rough_pose(picture, candidate)
            fit = find_from_eyes(self._model, picture, candidate.keypoints[:2], [start])
            if is_explained(self._model, fit):
                return fit
        return None


def _rough_pose(picture: Picture, face: Detection) -> Array:
    """(6,) of a detected face, from its eyes and nose (WP3P, thesis 5.1)."""
    head, size = generic_head(), (picture.shape[1], picture.shape[0])
    camera = generic_identity(head, size).camera
    return pose_vector_at(pose_from_three_points(head, camera, face), camera)


def on_network_landmarks(model: MultiResolutionModel, fit: FaceFit) -> Array:
    """(468, 3) landmarks of a fit in the order of the network, with the model's depth about the
    head's origin, pixels; nan where the model has none."""
    points, warp = np.full((LANDMARK_COUNT, 3), np.nan), model.warp(len(model.levels) - 1)
    points[warp.landmark_index, :2] = fit.landmarks
    points[warp.landmark_index, 2] = warp.landmark_depths(fit.shape, fit.pose)
    return points
