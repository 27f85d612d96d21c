"""Coarse pictures of layers, and their derivatives against differences."""

import cv2
import numpy as np
import pytest

from encoder.layers.displacement import moved_back, pixel_grid, sample
from encoder.layers.layer_drawing import DrawnLayers, draw_layers
from encoder.layers.scene_motion import gradient, scene_basis
from shared_model.arrays import Array, Single

SHAPE = (40, 48)
RANDOM = np.random.default_rng(3)
FIELDS, CHANGES, MOVING = 2, 2, 4


def smooth(low: float, high: float, *more: int) -> Single:
    noise = RANDOM.normal(0, 1, (*SHAPE, *more)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 5.0).reshape(noise.shape)
    return np.asarray(low + (high - low) * np.clip(0.5 + 2 * blurred, 0, 1), np.float32)


ALPHA, SCENE = smooth(0, 1), smooth(0, 250)
PERSON = smooth(20, 200) * ALPHA
CHANGED = smooth(-9, 9, CHANGES)
MOVES = np.array([smooth(-1, 1, 2) for _ in range(FIELDS)])
AT = (pixel_grid(SHAPE) + smooth(-1, 1, 2)).astype(np.float32)
# Where no position leaves the picture.
INNER = np.s_[6:-6, 6:-6]


def with_slopes(image: Single) -> Single:
    return np.dstack([image, gradient(image)])


def drawn(coefficients: Array, moving: int = MOVING) -> DrawnLayers:
    images = with_slopes(PERSON), with_slopes(ALPHA), with_slopes(SCENE)
    return draw_layers(*images, CHANGED, AT, MOVES, scene_basis(SHAPE)[:moving], coefficients)


def test_a_scene_at_rest_shows_through_where_the_person_is_not() -> None:
    own = np.array([0.6, -0.4, 1.5, -0.5])
    at = moved_back(AT, own[:FIELDS], MOVES)
    person, alpha, changed = (sample(each, at) for each in (PERSON, ALPHA, CHANGED))
    mixed = (1 - alpha[..., None]) * CHANGED + alpha[..., None] * changed
    expected = (1 - alpha) * SCENE + person + mixed @ own[FIELDS:].astype(np.float32)
    shown = drawn(own, moving=0)
    np.testing.assert_allclose(shown.picture, expected, rtol=0, atol=1e-3)
    np.testing.assert_allclose(shown.alpha, alpha, rtol=0, atol=1e-5)
    assert len(shown.rows) == FIELDS + CHANGES


@pytest.mark.parametrize("number", range(FIELDS + CHANGES + MOVING))
def test_each_row_is_the_derivative_by_its_coefficient(number: int) -> None:
    own = np.array([0.4, -0.3, 0.0, 0.0, 1.0, -0.6, 0.4, 0.7])
    step = np.zeros(len(own))
    step[number] = 1.0
    change = (drawn(own + step).picture - drawn(own - step).picture) / 2
    difference = change - drawn(own).rows[number]
    assert np.sqrt((difference[INNER] ** 2).mean()) < 0.15 * np.sqrt((change[INNER] ** 2).mean())
