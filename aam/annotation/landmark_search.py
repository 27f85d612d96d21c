"""The landmarks of the largest face in a still picture: by the landmark network or a model."""

import cv2
import numpy as np

from aam.model import MultiResolutionModel
from aam.search.face_finder import FaceFinder, on_network_landmarks
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import Detection
from encoder.detection.iris import IrisLandmarker
from encoder.detection.landmarks import FaceMesh
from encoder.detection.roi import roi_from_detection, roi_from_landmarks
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError

MIN_SCORE = 0.5
# Runs of the network; each gives the region of the next.
RUNS = 3
# Margin that is added where no face is found: detectors miss faces that fill the picture.
MARGIN = 0.5
# Smaller pictures are enlarged for the networks.
LEAST_SIDE_PX = 256


class StillLandmarks:
    """Finds landmarks in pictures.  Raises `UserError` if the networks are not installed."""

    def __init__(self) -> None:
        try:
            folder = find_network_folder()
        except NetworkFilesMissing as error:
            raise UserError(f"{error}; give landmarks by --landmarks") from error
        self._detector = BlazeFaceDetector(folder)
        self._mesh, self._eyes = FaceMesh(folder), IrisLandmarker(folder)

    def find(self, picture: Picture) -> Array | None:
        """(468, 3) pixels and depth, None if there is no face.  picture: (h, w, 3) uint8 BGR."""
        zoom = int(np.ceil(LEAST_SIDE_PX / min(picture.shape[:2])))
        large = picture
        if zoom > 1:
            resized = cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
            large = np.asarray(resized, np.uint8)
        found = self._find(large, 0)
        if found is None:
            found = self._find(large, round(MARGIN * max(large.shape[:2])))
        if found is None:
            return None
        found[:, :2] = (found[:, :2] + 0.5) / zoom - 0.5
        found[:, 2] /= zoom
        return found

    def detect(self, picture: Picture) -> list[Detection]:
        """The faces that the detector finds, the largest first."""
        return self._detector.detect(picture)

    def _find(self, picture: Picture, margin: int) -> Array | None:
        wide = cv2.copyMakeBorder(picture, *(margin,) * 4, cv2.BORDER_REPLICATE)
        frame = np.asarray(wide, np.uint8)
        for face in self._detector.detect(frame):
            roi = roi_from_detection(face)
            for _ in range(RUNS):
                found = self._mesh.find(frame, roi)
                roi = roi_from_landmarks(found.points)
            if found.score >= MIN_SCORE:
                points = self._eyes.replace_eyelids(frame, found.points)
                return np.asarray(points - [margin, margin, 0])
        return None


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
