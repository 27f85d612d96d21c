"""Whether a decoded face is still that person's, for a face recognition network."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from encoder.detection.landmark_indices import FACE_OVAL, OUTER_EYE_CORNERS
from loopback.judge.programs import run_program
from shared_model.arrays import Array, Picture, Single

# Pixels of the network's input; the side of the square around a face, in terms of its outline's.
SIDE, MARGIN = 224, 1.2
FEATURES = 1024


def face_crop(picture: Picture, points: Array) -> Picture:
    """(224, 224, 3) uint8 RGB: a face upright.  points: (468, >= 2) pixels of the picture."""
    outline = points[list(FACE_OVAL), :2]
    low, high = outline.min(0), outline.max(0)
    along = points[OUTER_EYE_CORNERS[1], :2] - points[OUTER_EYE_CORNERS[0], :2]
    scale = SIDE / (MARGIN * float((high - low).max()))
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    centre = (low + high) / 2
    turn = cv2.getRotationMatrix2D((float(centre[0]), float(centre[1])), angle, scale)
    turn[:, 2] += (SIDE - 1) / 2 - centre
    crop = cv2.warpAffine(picture, turn, (SIDE, SIDE), flags=cv2.INTER_LINEAR)
    return np.asarray(crop[..., ::-1], np.uint8)


class FaceRecogniser:
    """Runs the network in the judge's environment.

    folder: that has node_modules.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def features(self, crops: Sequence[Picture]) -> Single:
        """(n, 1024) of unit length, for crops as `face_crop` makes them.

        Raises `UserError` if the judge fails.
        """
        program = str(Path(__file__).with_name("identity_program.cjs"))
        modules = self._folder / "node_modules"
        pieces = (np.ascontiguousarray(crop).tobytes() for crop in crops)
        command, where = ["node", program, str(modules)], os.environ | {"NODE_PATH": str(modules)}
        data = run_program(command, pieces, "the judge failed", where)
        found = np.frombuffer(data, np.float32).reshape(-1, FEATURES)
        lengths = np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)
        return np.asarray(found / lengths, np.float32)


def find_recogniser(python: Path) -> FaceRecogniser | None:
    """That of the environment with this Python; None if it is not installed."""
    folder = python.parent.parent
    has_network = (folder / "node_modules/@vladmandic/human/models/faceres.bin").is_file()
    return FaceRecogniser(folder) if has_network and shutil.which("node") else None


def mean_likeness(first: Single, second: Single) -> float:
    """The mean cosine of features (n, 1024) of the same n moments."""
    return float((first * second).sum(1).mean())
