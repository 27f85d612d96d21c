"""A background without layers gets the light of a later frame, where that has changed."""

import cv2
import numpy as np

from encoder.coding.background import BackgroundImage, background_in_light
from shared_model.arrays import Picture

PERSON = np.zeros((96, 96), np.bool_)
PERSON[40:, 30:66] = True


def room(gain: float = 1.0, coat_grey: int = 90) -> Picture:
    noise = np.random.default_rng(3).normal(0, 1, (120, 160, 3))
    wall = np.clip(120 + 200 * cv2.GaussianBlur(noise, (0, 0), 4.0), 0, 255)
    wall[50:, 50:110] = coat_grey
    return np.asarray(np.rint(np.clip(gain * wall, 0, 255)), np.uint8)


def test_a_light_that_is_switched_on_lights_the_whole_background() -> None:
    dark = BackgroundImage(room(0.3), PERSON)
    found = background_in_light(dark, room())
    assert found is not None and found.foreground is dark.foreground
    assert np.abs(found.picture.astype(int) - room()).mean() < 4


def test_in_the_same_light_it_stays_whatever_the_person_does() -> None:
    before = BackgroundImage(room(), PERSON)
    assert background_in_light(before, room()) is None
    assert background_in_light(before, room(1.02)) is None
    assert background_in_light(before, room(coat_grey=250)) is None
    assert background_in_light(before, np.ascontiguousarray(room()[::-1])) is None
