"""The colour that a texture takes where none was sent."""

import numpy as np
import pytest

from decoder.rendering.texture_colour import LocalColours
from protocol.pictures.picture_codec import to_luma, to_planes
from shared_model.appearance import atlas_of
from shared_model.arrays import Mask, Single
from shared_model.mesh import PARTS
from shared_model.surround import head_with_surround

SIZE = 96
SKIN = (60, 90, 150)
# Rows and columns of texels of the forehead's middle that are dark in the mean.
DARK = slice(20, 26), slice(44, 52)


def part_texels(name: str) -> Mask:
    head, texels = head_with_surround(), np.zeros((SIZE, SIZE), np.bool_)
    atlas = atlas_of(head, SIZE)
    is_part = head.parts[atlas.corners[:, 0]] == PARTS.index(name)
    texels[atlas.rows[is_part], atlas.columns[is_part]] = True
    return texels


@pytest.fixture(scope="module")
def colours() -> LocalColours:
    mean = np.zeros((SIZE, SIZE, 3), np.uint8) + np.array(SKIN, np.uint8)
    mean[DARK] = 12
    return LocalColours(mean)


def grey_mode(level: float) -> Single:
    mode = np.zeros((SIZE, SIZE, 3), np.float32)
    mode[DARK] = level
    return mode


def test_what_comes_into_the_light_has_the_colour_of_the_skin_around(colours: LocalColours) -> None:
    mode = grey_mode(90)
    completed = colours.complete(mode)
    np.testing.assert_allclose(to_luma(completed), to_luma(mode), atol=1e-3)
    blue, green, red = colours.texture(completed.ravel())[23, 48]
    assert red > green + 10 > blue + 20
    # Without the colour the limits alone keep it from being grey.
    assert colours.texture(mode.ravel())[23, 48].tolist() != [102] * 3


def test_colour_that_was_sent_stays(colours: LocalColours) -> None:
    mode = grey_mode(60) + grey_mode(1) * np.array([-10, -4, 25], np.float32)
    np.testing.assert_allclose(colours.complete(mode)[23, 48], mode[23, 48], atol=0.5)


def test_a_foreign_colour_is_not_drawn(colours: LocalColours) -> None:
    mode = np.zeros((SIZE, SIZE, 3), np.float32)
    mode[50:60, 44:52] = 80, -20, -60
    drawn, luma = colours.texture(mode.ravel()), to_luma(np.array(SKIN) + mode[55, 48])
    y, blue, red = to_planes(drawn.astype(np.float32), 1.0)[55, 48]
    assert y == pytest.approx(luma, abs=1)
    assert blue < 3 and red > 0


def test_the_mean_and_the_eyes_stay_as_they_were_sent(colours: LocalColours) -> None:
    nothing = np.zeros(SIZE * SIZE * 3, np.float32)
    drawn = colours.texture(nothing)
    away = np.ones((SIZE, SIZE), np.bool_)
    away[DARK] = False
    assert np.abs(drawn[away].astype(int) - np.array(SKIN)).max() <= 1
    eye = part_texels("eye_left")
    mode = np.zeros((SIZE, SIZE, 3), np.float32)
    mode[eye] = 90, 0, -90
    np.testing.assert_array_equal(colours.complete(mode)[eye], mode[eye])
    drawn = colours.texture(mode.ravel())
    assert (drawn[eye] == np.array([150, 90, 60])).all()
