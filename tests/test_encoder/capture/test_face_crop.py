"""The crop of the face: its place, its size, and the positions in it."""

import cv2
import numpy as np
import pytest

from encoder.capture.colour import luma_u8
from encoder.capture.face_crop import MARGIN, crop_face, crop_window
from runtime.image_ops import sample_bicubic

POINTS = np.array([(60.0, 40.0, 0.0), (120.0, 40.0, 3.0), (90.0, 110.0, 1.0)])


def ramp(height: int = 161, width: int = 221) -> np.ndarray:
    """A picture whose blue is the column and green the row."""
    picture = np.zeros((height, width, 3), np.uint8)
    picture[..., 0] = np.arange(width)
    picture[..., 1] = np.arange(height)[:, None]
    return picture


def test_the_window_holds_the_face_and_a_margin() -> None:
    crop = crop_face(ramp(), POINTS, 1.0)
    height, width = crop.picture.shape[:2]
    margin = MARGIN * 70
    assert (crop.left, crop.top) == (60 - margin, 40 - margin)
    assert (crop.left + width, crop.top + height) == (120 + margin, 110 + margin)


@pytest.mark.parametrize("texel_px", [0.5, 1.0, 1.2, 2.0, 3.7])
def test_positions_in_the_frame_map_to_the_window(texel_px: float) -> None:
    crop = crop_face(ramp(), POINTS, texel_px)
    places = np.array([(70.0, 50.0), (100.5, 77.25), (118.0, 60.0)], np.float32)
    colours = sample_bicubic(crop.picture, crop.to_crop_px(places))
    # The picture's own levels are whole numbers.
    assert np.abs(colours[:, :2] - places).max() <= 1


def test_a_fine_picture_is_scaled_down_to_a_pixel_per_texel() -> None:
    whole, small = crop_face(ramp(), POINTS, 1.0), crop_face(ramp(), POINTS, 2.5)
    ratio = np.array(whole.picture.shape[:2]) / np.array(small.picture.shape[:2])
    assert ratio == pytest.approx(2.5, rel=0.03)
    assert small.scale == pytest.approx(1 / ratio[::-1], rel=1e-6)


@pytest.mark.parametrize("shift", [(-500, 0), (500, 0), (0, -500), (0, 500), (-70, -50)])
def test_a_face_at_or_beyond_the_border_has_a_window(shift: tuple[int, int]) -> None:
    crop = crop_face(ramp(), POINTS + np.array([*shift, 0.0]), 1.0)
    height, width = crop.picture.shape[:2]
    assert min(height, width) >= 2
    assert crop.left >= 0 and crop.top >= 0
    assert crop.left + width <= 221 and crop.top + height <= 161


def test_a_crop_in_luma_shows_the_same_window() -> None:
    crop = crop_face(ramp(), POINTS, 2.0)
    grey = crop.as_luma
    assert grey.picture.shape == crop.picture.shape[:2] and grey.as_luma is grey
    assert (grey.left, grey.top) == (crop.left, crop.top)
    assert np.abs(grey.picture - cv2.cvtColor(crop.picture, cv2.COLOR_BGR2GRAY)).max() < 1


@pytest.mark.parametrize("texel_px", [1.0, 2.5])
def test_a_window_of_luma_is_the_luma_of_a_window(texel_px: float) -> None:
    picture = ramp()
    grey = luma_u8(picture)
    assert luma_u8(grey) is grey
    window, expected = crop_face(grey, POINTS, texel_px), crop_face(picture, POINTS, texel_px)
    assert (window.left, window.top) == (expected.left, expected.top)
    # Either is rounded to whole grey levels before and after it is shrunk.
    difference = window.picture.astype(int) - luma_u8(expected.picture)
    assert np.abs(difference).max() <= (0 if texel_px == 1 else 1)


def test_positions_go_from_the_window_to_the_frame_and_back() -> None:
    crop = crop_face(ramp(), POINTS, 2.5)
    places = np.array([(70.0, 50.0), (100.5, 77.25)])
    back = crop.to_frame_px(crop.to_crop_px(places.astype(np.float32)).astype(np.float64))
    assert back == pytest.approx(places, abs=1e-3)


def test_what_is_hidden_lies_within_the_outlines() -> None:
    crop = crop_face(ramp(), POINTS, 2.0)
    square = np.array([(80.0, 60.0), (100, 60), (100, 80), (80, 80)])
    hidden = crop.hiding([square])
    places = np.array([(90.0, 70.0), (70, 70), (90, 100), (-500, 70), (np.nan, 0)], np.float32)
    shown = hidden.shows(crop.to_crop_px(places))
    assert shown.tolist() == [False, True, True, True, True]
    assert hidden.as_luma.hidden is hidden.hidden
    assert crop.shows(crop.to_crop_px(places)).all()
    assert crop.hiding([square + 5000]) is crop and crop.hiding([]) is crop


@pytest.mark.parametrize("left, top, side", [(30, 20, 100), (-40, 90, 200), (900, 900, 50)])
def test_a_square_window_is_cut_at_the_border_and_shrunk(left: int, top: int, side: int) -> None:
    crop = crop_window(ramp(), (left, top, side), 64)
    assert 1 <= max(crop.picture.shape[:2]) <= 64
    height, width = crop.picture.shape[:2]
    corners = crop.to_frame_px(np.array([(-0.5, -0.5), (width - 0.5, height - 0.5)]))
    assert corners.min() >= -0.5 and (corners[1] <= (220.5, 160.5)).all()
    if min(crop.picture.shape[:2]) > 8:
        middle = np.array([[(width - 1) / 2, (height - 1) / 2]])
        colours = sample_bicubic(crop.picture, middle.astype(np.float32))
        assert colours[0, :2] == pytest.approx(crop.to_frame_px(middle)[0], abs=1.5)
