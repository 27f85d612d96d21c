"""The picture of the scene, and how it moves."""

from dataclasses import replace

import numpy as np
from heads import synthetic_head

from encoder.layers.displacement import pixel_grid, sample
from encoder.layers.layer_fitter import LayerFitter
from encoder.layers.layer_samples import CoarseFrame
from encoder.layers.scene import SceneLayer
from encoder.layers.scene_motion import scene_basis, scene_origins
from runtime.image_ops import blurred
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.head_motion import make_background_mesh
from shared_model.layers.scene_motion import displacement_basis
from shared_model.parameters import AAUS

SIZE, SHAPE = (160, 120), (108, 144)


def test_a_position_comes_from_where_the_displacement_of_the_scene_takes_it() -> None:
    motion = np.array([[0.0] * 4, [3.0, -2.0, 5.0, -4.0]])
    scene, shape = SceneLayer(np.zeros((60, 80, 3), np.float32), motion), (60, 80)
    at = np.random.default_rng(3).uniform(0, 60, (7, 5, 2)).astype(np.float32)
    # The pictures are half as large as the source.
    there = (2 * at + 0.5).astype(np.float64)
    moved = np.tensordot(motion[1], displacement_basis(160, 120, there), 1) / 2
    assert np.array_equal(scene.origins(0, at, shape, SIZE), at)
    assert np.abs(scene.origins(1, at, shape, SIZE) - (at - moved)).max() < 1e-5


def test_a_fit_may_begin_with_the_motion_of_the_scene_that_it_would_find() -> None:
    head, camera = synthetic_head(12, 16), Camera(*SIZE, 200.0)
    face = Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))
    pose = pose_from_euler(0, 0, 0, np.array([0.0, 40.0, 900.0]))
    mesh = make_background_mesh(camera, pose, head, head.vertices)
    noise = np.random.default_rng(5).uniform(0, 255, SHAPE).astype(np.float32)
    scene, nothing = blurred(noise, 3.0) * 4 - 380, np.zeros(SHAPE, np.float32)
    free = np.tile([-np.inf, np.inf], (4, 1))
    none = np.zeros((0, *SHAPE), np.float32)
    fields = np.zeros((0, *SHAPE, 2), np.float32)
    fitter = LayerFitter(face, mesh, SIZE, nothing, nothing, scene, fields, none, free, True)
    true = np.array([1.0, -0.5, 0.5, 0.3])
    luma = sample(scene, scene_origins(scene_basis(SHAPE), true))
    frame = CoarseFrame(luma, pixel_grid(SHAPE), np.ones(SHAPE, np.float32))
    known = fitter.with_scene_motion(frame)
    found = fitter.fit_motion(frame)
    assert np.abs(found - true).max() < 0.1
    assert known.scene_motion is not None
    assert np.array_equal(fitter.fit_motion(known), found)
    far = replace(known, scene_motion=known.scene_motion + 3)
    assert not np.array_equal(fitter.fit_motion(far), found)
