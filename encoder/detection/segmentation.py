"""Segmentation of the caller from the background: MediaPipe's selfie segmentation network."""

import threading
from pathlib import Path

import cv2
import numpy as np

from encoder.detection.tflite import TfliteNetwork
from protocol.pictures.foreground_mask import MASK_SIDE
from runtime.image_ops import hull_mask
from shared_model.arrays import Array, Mask, Picture, Single

INPUT_PX = 256
# The segmented people are those of the face if they cover at least this share of its outline.
MIN_FACE_OVERLAP = 0.9
# Size of the morphological closing, cells of the mask.
CLOSING_CELLS = 5
# Cells of a matte along each side, for any shape of picture.
MATTE_SIDE = 128
# A matte of more than this belongs to a person; less is their soft edge.
PERSON = 0.5
# A frame is dark if this percentile of its values is below so many grey levels; it gets so many.
BRIGHT_PERCENTILE, DARK_GREY, LIT_GREY = 99, 96, 220
# Size of the morphological closing and of the soft edge, cells of a matte.
MATTE_CLOSING_CELLS, MATTE_EDGE_CELLS = 7, 5


def segment_person(path: Path, frame: Picture, outline_px: Array) -> Mask | None:
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


class PersonSegmenter:
    """Finds the person with a given face; each thread that uses it has a network of its own.

    path: of the network.  Raises `NetworkFilesMissing` if it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._of_thread = path, threading.local()
        self._of_thread.network = TfliteNetwork(path)

    def matte(self, frame: Picture, outline_px: Array) -> Single | None:
        """(MATTE_SIDE, MATTE_SIDE) share 0..1 of the person; None if the network finds none there.

        frame: (h, w, 3) uint8 BGR.  outline_px: (n, 2) of the face, pixels.
        Other people, who do not touch the person, are left out.
        """
        people = self.share(frame)
        corners = (outline_px + 0.5) * MATTE_SIDE / np.array(frame.shape[1::-1]) - 0.5
        face = hull_mask(corners, people.shape) > 0
        if (people[face] > PERSON).sum() < MIN_FACE_OVERLAP * face.sum():
            return None
        kernel = np.ones((MATTE_CLOSING_CELLS, MATTE_CLOSING_CELLS), np.uint8)
        solid = ((people > PERSON) | face).astype(np.uint8)
        closed = cv2.morphologyEx(solid, cv2.MORPH_CLOSE, kernel)
        _, components = cv2.connectedComponents(closed)
        person = (components == np.bincount(components[face]).argmax()).astype(np.uint8)
        edge = np.ones((MATTE_EDGE_CELLS, MATTE_EDGE_CELLS), np.uint8)
        near = cv2.dilate(person, edge) > 0
        # What the closing has filled is the person, too.
        inside = cv2.erode(person, edge) > 0
        return np.where(inside, 1, people * near).astype(np.float32)

    def share(self, frame: Picture) -> Single:
        """(MATTE_SIDE, MATTE_SIDE) share 0..1 of people in the cells of a frame."""
        size = (MATTE_SIDE, MATTE_SIDE)
        if not hasattr(self._of_thread, "network"):
            self._of_thread.network = TfliteNetwork(self._path)
        cells = _probability(self._of_thread.network, frame)
        return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_AREA), np.float32)


def person_probability(path: Path, frame: Picture) -> Single:
    """(INPUT_PX, INPUT_PX): how likely each cell of the whole frame shows a person, 0 to 1.

    path: of the network.  frame: (h, w, 3) uint8 BGR.
    Raises `NetworkFilesMissing` if the network cannot be read.
    """
    return _probability(TfliteNetwork(path), frame)


def _probability(network: TfliteNetwork, frame: Picture) -> Single:
    square = np.asarray(cv2.resize(frame, (INPUT_PX, INPUT_PX), interpolation=cv2.INTER_AREA))
    probability = network.run(_brightened(square.astype(np.uint8)), low=0.0)[INPUT_PX**2]
    return np.asarray(probability.reshape(INPUT_PX, INPUT_PX))


def _brightened(frame: Picture) -> Picture:
    """A frame whose light the network knows: one of a dark room with more contrast."""
    brightest = float(np.percentile(frame, BRIGHT_PERCENTILE))
    if brightest >= DARK_GREY:
        return frame
    return np.asarray(cv2.convertScaleAbs(frame, alpha=LIT_GREY / max(brightest, 1.0)), np.uint8)


def _segment_people(path: Path, frame: Picture) -> Mask:
    """(SIDE, SIDE) bool: the cells of a frame that show people."""
    in_cells = cv2.resize(
        person_probability(path, frame), (MASK_SIDE, MASK_SIDE), interpolation=cv2.INTER_AREA
    )
    return np.asarray(in_cells > 0.5)
