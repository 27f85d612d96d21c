"""The background of a model packet: what a decoder draws the face onto.

It has layers (`encoder.layers`), or is one picture with the mask of the person in it.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from encoder.capture.colour import luma_f32
from encoder.detection.segmentation import segment_person
from encoder.detection.tflite import find_segmentation_network
from encoder.layers.layer_samples import coarse_picture, shrunk
from encoder.layers.light import fit_light, lit, lit_picture
from encoder.picture_coding.image_budget import (
    BACKGROUND_SIDES_PX,
    ROUGH_SIDE_PX,
    encode_background_within,
)
from protocol.pictures.foreground_mask import serialise_background
from shared_model.arrays import Array, Mask, Picture
from shared_model.layers.light import light_of

# A background is worth its bytes again if the light has changed it by so many grey levels.
MIN_CHANGE_GREY = 6.0


class Background(Protocol):
    """What a decoder draws the face onto."""

    def encode(self, max_bytes: int) -> bytes:
        """A model packet's background, as fine as `max_bytes` allow."""

    def encode_rough(self, max_bytes: int) -> bytes:
        """The same for a base layer, without what the coefficients of frames change."""


# Encodes a background in at most so many bytes, beside what its caller does.
EncodeBackground = Callable[[Background, int], "Future[bytes]"]


@dataclass(frozen=True, slots=True)
class BackgroundImage:
    """A background without layers.

    picture: (h, w, 3) uint8 BGR, a frame of the call.
    foreground: the mask of the person in it; None if that is not known.
    """

    picture: Picture
    foreground: Mask | None = None

    def encode(self, max_bytes: int) -> bytes:
        """Mask and picture, the picture as fine as `max_bytes` for both allow."""
        return self._encode(max_bytes, BACKGROUND_SIDES_PX[0])

    def encode_rough(self, max_bytes: int) -> bytes:
        """See `Background`."""
        return self._encode(max_bytes, ROUGH_SIDE_PX)

    def _encode(self, max_bytes: int, side_px: int) -> bytes:
        mask = serialise_background(self.foreground, b"")
        return mask + encode_background_within(self.picture, max_bytes - len(mask), side_px)


def encoded_in_a_thread(background: Background, max_bytes: int) -> "Future[bytes]":
    """Encode a background in a thread of this process."""
    executor = ThreadPoolExecutor(1)
    encoded = executor.submit(background.encode, max_bytes)
    executor.shutdown(wait=False)
    return encoded


def background_of(frame: Picture, outline_px: Array) -> BackgroundImage:
    """The background image of a frame (h, w, 3) uint8 BGR that shows the caller.

    outline_px: (n, 2) pixels, the outline of the caller's face.
    The mask is left out where the segmentation network is not installed.
    """
    path = find_segmentation_network()
    return BackgroundImage(frame, segment_person(path, frame, outline_px) if path else None)


def background_in_light(background: BackgroundImage, newest: Picture) -> BackgroundImage | None:
    """The background in the light of a frame (h, w, 3) BGR; None if it has about that light."""
    coarse = coarse_picture(newest)
    shape = coarse.shape[0], coarse.shape[1]
    before, after = luma_f32(shrunk(background.picture, shape)), luma_f32(coarse)
    weight = np.ones_like(before)
    if background.foreground is not None:
        person = background.foreground.astype(np.float32)
        weight -= cv2.resize(person, before.shape[::-1], interpolation=cv2.INTER_LINEAR)
    light = light_of(fit_light(before, after, weight))
    if float(np.abs(lit(before, light) - before).mean()) < MIN_CHANGE_GREY:
        return None
    return replace(background, picture=lit_picture(background.picture, light))
