"""Pictures shrunk by the mean of areas, beside OpenCV's."""

import cv2
import numpy as np
import pytest

from runtime.area_resize import area_resized


@pytest.mark.parametrize("size", [(48, 64), (24, 32), (31, 47), (11, 64), (1, 1), (47, 63)])
def test_areas_are_those_of_opencv(size: tuple[int, int]) -> None:
    picture = np.random.default_rng(1).integers(0, 256, (64, 48, 3)).astype(np.uint8)
    expected = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).reshape(*size[::-1], 3)
    found = area_resized(picture, size)
    assert found.dtype == np.uint8 and found.shape == expected.shape
    # One level where a mean lies between two.
    assert np.abs(found.astype(int) - expected).max() <= 1
    assert (found != expected).mean() < 0.02


def test_a_part_of_a_picture_is_resized_and_bright_pixels_stay_bright() -> None:
    picture = np.full((50, 60, 3), 255, np.uint8)
    picture[:, 30:] = 7
    part = picture[3:40, 10:51]
    small = area_resized(part, (29, 23))
    assert small.max() == 255 and small.min() == 7


def test_grey_pictures_are_resized_as_well() -> None:
    picture = np.random.default_rng(2).integers(0, 256, (64, 48)).astype(np.uint8)
    expected = cv2.resize(picture, (31, 47), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(area_resized(picture, (31, 47)), expected)
