"""Frames without a face are looked at: is somebody still there?"""

import numpy as np
import pytest

from encoder.detection.tflite import find_segmentation_network
from encoder.learning.absence import KEPT_FRAMES, AbsenceWatch


def test_a_wall_is_nobody_and_a_few_pictures_of_it_are_kept() -> None:
    if find_segmentation_network() is None:
        pytest.skip("needs the segmentation network")
    watch, wall = AbsenceWatch(), np.full((60, 80, 3), 150, np.uint8)
    for index in range(10, 30):
        watch.take(index, wall)
    assert watch.empty == set(range(10, 30))
    assert KEPT_FRAMES <= len(watch.pictures) < 2 * KEPT_FRAMES


def test_before_any_frame_nobody_is_missing() -> None:
    watch = AbsenceWatch()
    assert not watch.empty and not watch.pictures
