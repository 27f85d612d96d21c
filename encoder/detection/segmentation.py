"""Who is before the background of a still: MediaPipe's selfie segmentation."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.tflite import Network
from encoder.runtime.image_ops import hull_mask
from protocol.pictures.foreground_mask import SIDE, Map

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 256
# Less than this share of the face's outline within the silhouette, and it is somebody else's.
LEAST_FACE = 0.9
# Holes and cracks of this many places are closed.
CLOSED = 5


def find_silhouette(path: Path, frame: Frame, outline_px: Array) -> Map | None:
    """The person whose face is given, in a picture (h, w, 3) BGR; None if none is found there.

    path: of the network.  outline_px: (n, 2) of the face.
    Raises `NetworkFilesMissing` if the network cannot be read.
    """
    square = np.asarray(cv2.resize(frame, (INPUT_PX, INPUT_PX), interpolation=cv2.INTER_AREA))
    shares = Network(path).run(square.astype(np.uint8), low=0.0)[INPUT_PX**2]
    likely = cv2.resize(
        shares.reshape(INPUT_PX, INPUT_PX), (SIDE, SIDE), interpolation=cv2.INTER_AREA
    )
    somebody = likely > 0.5
    corners = (outline_px + 0.5) * SIDE / np.array(frame.shape[1::-1]) - 0.5
    face = hull_mask(corners, (SIDE, SIDE)) > 0
    if (somebody & face).sum() < LEAST_FACE * face.sum():
        return None
    either = (somebody | face).astype(np.uint8)
    closed = cv2.morphologyEx(either, cv2.MORPH_CLOSE, np.ones((CLOSED, CLOSED), np.uint8))
    _, parts = cv2.connectedComponents(closed)
    numbers = np.bincount(parts[face])
    own = np.asarray(parts == numbers.argmax())
    return None if own.all() else own
