"""Segmentation of the caller from the background: MediaPipe's selfie segmentation network."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.tflite import TfliteNetwork
from encoder.runtime.image_ops import hull_mask
from protocol.pictures.foreground_mask import MASK_SIDE, Mask

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 256
# The segmented people are those of the face if they cover at least this share of its outline.
MIN_FACE_OVERLAP = 0.9
# Size of the morphological closing, cells of the mask.
CLOSING_CELLS = 5


def segment_person(path: Path, frame: Frame, outline_px: Array) -> Mask | None:
    """The mask of the person with the given face; None if the network finds none there.

    path: of the network.  frame: (h, w, 3) uint8 BGR.  outline_px: (n, 2) of the face, pixels.
    Raises `NetworkFilesMissing` if the network cannot be read.
    """
    people = _segment_people(path, frame)
    corners = (outline_px + 0.5) * MASK_SIDE / np.array(frame.shape[1::-1]) - 0.5
    face = hull_mask(corners, (MASK_SIDE, MASK_SIDE)) > 0
    if (people & face).sum() < MIN_FACE_OVERLAP * face.sum():
        return None
    kernel = np.ones((CLOSING_CELLS, CLOSING_CELLS), np.uint8)
    closed = cv2.morphologyEx((people | face).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    _, components = cv2.connectedComponents(closed)
    areas = np.bincount(components[face])
    person = np.asarray(components == areas.argmax())
    return None if person.all() else person


def person_probability(path: Path, frame: Frame) -> NDArray[np.float32]:
    """(INPUT_PX, INPUT_PX): how likely each cell of the whole frame shows a person, 0 to 1.

    path: of the network.  frame: (h, w, 3) uint8 BGR.
    Raises `NetworkFilesMissing` if the network cannot be read.
    """
    square = np.asarray(cv2.resize(frame, (INPUT_PX, INPUT_PX), interpolation=cv2.INTER_AREA))
    probability = TfliteNetwork(path).run(square.astype(np.uint8), low=0.0)[INPUT_PX**2]
    return np.asarray(probability.reshape(INPUT_PX, INPUT_PX))


def _segment_people(path: Path, frame: Frame) -> Mask:
    """(SIDE, SIDE) bool: the cells of a frame that show people."""
    in_cells = cv2.resize(
        person_probability(path, frame), (MASK_SIDE, MASK_SIDE), interpolation=cv2.INTER_AREA
    )
    return np.asarray(in_cells > 0.5)
