"""The background of a call that has no layers yet, in the light of a later frame."""

from dataclasses import replace

import cv2
import numpy as np

from encoder.capture.colour import luma_f32
from encoder.coding.background import BackgroundImage
from encoder.layers.layer_samples import coarse_picture, shrunk
from encoder.layers.light import fit_light, lit, lit_picture
from shared_model.arrays import Picture
from shared_model.layers.light import light_of

# A background is worth its bytes again if the light has changed it by so many grey levels.
MIN_CHANGE_GREY = 6.0


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
