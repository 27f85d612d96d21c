"""The picture of the scene, and how it moves."""

import numpy as np

from encoder.layers.scene import SceneLayer
from shared_model.layers.scene_motion import displacement_basis


def test_a_position_comes_from_where_the_displacement_of_the_scene_takes_it() -> None:
    motion = np.array([[0.0] * 4, [3.0, -2.0, 5.0, -4.0]])
    scene, shape = SceneLayer(np.zeros((60, 80, 3), np.float32), motion), (60, 80)
    at = np.random.default_rng(3).uniform(0, 60, (7, 5, 2)).astype(np.float32)
    # The pictures are half as large as the source.
    there = (2 * at + 0.5).astype(np.float64)
    moved = np.tensordot(motion[1], displacement_basis(160, 120, there), 1) / 2
    assert np.array_equal(scene.origins(0, at, shape, (160, 120)), at)
    assert np.abs(scene.origins(1, at, shape, (160, 120)) - (at - moved)).max() < 1e-5
