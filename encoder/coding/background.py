"""The background of a model packet: the picture behind the face, and the mask of the person."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.detection.segmentation import segment_person
from encoder.detection.tflite import find_segmentation_network
from encoder.picture_coding.image_budget import encode_background_within
from protocol.pictures.foreground_mask import Mask, serialise_background

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class BackgroundImage:
    """The picture that a decoder draws the face onto.

    picture: (h, w, 3) uint8 BGR, a frame of the call.
    foreground: the mask of the person in it; None if that is not known.
    """

    picture: Frame
    foreground: Mask | None = None

    def encode(self, max_bytes: int) -> bytes:
        """Mask and picture, the picture as fine as `max_bytes` for both allow."""
        mask_bytes = len(serialise_background(self.foreground, b""))
        picture = encode_background_within(self.picture, max_bytes - mask_bytes)
        return serialise_background(self.foreground, picture)


def background_of(frame: Frame, outline_px: Array) -> BackgroundImage:
    """The background image of a frame (h, w, 3) uint8 BGR that shows the caller.

    outline_px: (n, 2) pixels, the outline of the caller's face.
    The mask is left out where the segmentation network is not installed.
    """
    path = find_segmentation_network()
    return BackgroundImage(frame, segment_person(path, frame, outline_px) if path else None)
