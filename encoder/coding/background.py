"""The background of a model packet: the picture behind the face, and who is in it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.detection.segmentation import find_silhouette
from encoder.detection.tflite import find_segmentation
from encoder.picture_coding.image_budget import code_background
from protocol.pictures.foreground_mask import Map, serialise_background

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Still:
    """What the background shows: a picture (h, w, 3) BGR, and who is in it, if known."""

    picture: Frame
    silhouette: Map | None = None

    def coded(self, max_bytes: int) -> bytes:
        """The background of a model packet: the nearest to it of at most `max_bytes`."""
        before = len(serialise_background(self.silhouette, b""))
        still = code_background(self.picture, max_bytes - before)
        return serialise_background(self.silhouette, still)


def still_of(frame: Frame, outline_px: Array) -> Still:
    """The still of a caller's first picture (h, w, 3) BGR.

    outline_px: (n, 2) of the face.  Without the network nobody is told from what is behind.
    """
    path = find_segmentation()
    return Still(frame, find_silhouette(path, frame, outline_px) if path else None)
