"""Texture samples as an appearance encoder compares them."""

import numpy as np

from encoder.learning.appearance_encoder import weighted_planes, without_mean
from protocol.pictures.picture_codec import to_planes


def test_weighted_planes_are_the_planes_of_visible_texels_times_their_weight() -> None:
    random = np.random.default_rng(3)
    colours = random.uniform(0, 255, (4, 50, 3)).astype(np.float32)
    visible, root = random.random((4, 50)) > 0.3, random.random(50).astype(np.float32)
    expected = to_planes(colours) * root[:, None] * visible[..., None]
    np.testing.assert_array_equal(weighted_planes(colours, visible, root), expected)


def test_a_mean_is_taken_from_visible_texels_alone() -> None:
    frames, mean = np.full((2, 2, 3), 5, np.float32), np.full((2, 3), 2, np.float32)
    left = without_mean(frames, mean, np.array([[True, False], [False, True]]))
    assert left[..., 0].tolist() == [[3, 5], [5, 3]]
