"""Segmentation of the caller from the background."""

import numpy as np
import pytest

from encoder.detection.segmentation import PersonSegmenter
from encoder.detection.tflite import find_segmentation_network
from runtime.parallel import parallel_map


def test_several_threads_see_what_one_sees() -> None:
    path = find_segmentation_network()
    if path is None:
        pytest.skip("needs the segmentation network")
    pictures = np.random.default_rng(7).integers(0, 255, (12, 60, 80, 3)).astype(np.uint8)
    segmenter = PersonSegmenter(path)
    alone, beside = (parallel_map(segmenter.share, pictures, workers) for workers in (1, 3))
    assert np.array_equal(alone, beside)
    assert np.ptp(alone) > 0
