"""Smooth curves go through their points, and nowhere beyond them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared_model.curves import smooth_curve

HEIGHTS = st.lists(st.floats(-100, 100), min_size=2, max_size=8)


@given(HEIGHTS)
def test_a_curve_goes_through_its_points(heights: list[float]) -> None:
    places = np.arange(len(heights)) * 1.5
    np.testing.assert_allclose(smooth_curve(places, places, heights), heights, atol=1e-9)


@given(HEIGHTS)
def test_between_two_points_a_curve_stays_between_their_values(heights: list[float]) -> None:
    for k, (a, b) in enumerate(pairwise(heights)):
        between = smooth_curve(np.linspace(k, k + 1, 21), np.arange(len(heights)), heights)
        assert between.min() >= min(a, b) - 1e-9 and between.max() <= max(a, b) + 1e-9
        assert np.all(np.diff(between) * np.sign(b - a) >= -1e-9)


def test_a_curve_has_no_corner_at_its_points() -> None:
    places, heights, step = [0, 1, 3, 4], [0.0, 2.0, 3.0, -1.0], 1e-5
    for place in places:
        before, at, after = smooth_curve([place - step, place, place + step], places, heights)
        assert abs((after - at) - (at - before)) / step < 1e-2


def test_a_curve_is_held_before_its_first_and_after_its_last_point() -> None:
    np.testing.assert_array_equal(smooth_curve([-9, 9], [0, 1], [3, 5]), [3, 5])
    np.testing.assert_array_equal(smooth_curve([-9, 0, 9], [0], [4]), [4, 4, 4])


@pytest.mark.parametrize(
    ("places", "heights"), [([], []), ([0, 0], [1, 2]), ([1, 0], [1, 2]), ([0, 1], [1])]
)
def test_points_that_make_no_curve_are_refused(places: list[float], heights: list[float]) -> None:
    with pytest.raises(ValueError, match="places"):
        smooth_curve([0.5], places, heights)
