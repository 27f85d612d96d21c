"""The shape-free frame: projection of texels, and its derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from shots import Shots

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.fitting.increments import apply_increment
from shared_model.appearance import atlas_of
from shared_model.geometry import pixel_from_head
from shared_model.parameters import EAU_INDEX, EAUS


@pytest.fixture(scope="module")
def shape(shots: Shots) -> ShapeFreeFrame:
    return ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 48), shots.camera)


def test_texels_project_as_the_mesh_does(shots: Shots, shape: ShapeFreeFrame) -> None:
    for face in shots.faces:
        vertices = shots.face.animate(face.eau)
        expected = pixel_from_head(shots.camera, face.pose, shape.atlas.points(vertices))
        assert np.abs(shape.positions(face) - expected).max() < 0.01
    assert len(shape) == len(shape.atlas.rows)


@pytest.mark.parametrize("number", range(6 + len(EAUS)))
def test_the_image_jacobian_is_the_numeric_derivative(
    shots: Shots, shape: ShapeFreeFrame, number: int
) -> None:
    # Away from zero and from the limits, where actuators have kinks.
    face = replace(shots.faces[3], eau=np.full(len(EAUS), 0.3))
    size = 1e-3 if number < 3 else 1e-2
    step = np.zeros(6 + len(EAUS))
    step[number] = size
    ahead, behind = (
        shape.positions(apply_increment(face, step)),
        shape.positions(apply_increment(face, -step)),
    )
    measured = (ahead - behind) / (2 * size)
    gradient = np.tile(np.array([[0.6], [-0.8]], np.float32), len(shape))
    stated = shape.image_jacobian(shape.project(face), gradient, np.arange(len(EAUS)))[number]
    expected = measured @ gradient[:, 0]
    assert np.abs(stated - expected).max() < 0.02 * np.abs(measured).max() + 0.1


def test_the_jacobian_has_a_row_for_each_active_actuator(
    shots: Shots, shape: ShapeFreeFrame
) -> None:
    gradient = np.ones((2, len(shape)), np.float32)
    every = shape.image_jacobian(shape.project(shots.faces[1]), gradient, np.arange(len(EAUS)))
    few = shape.image_jacobian(shape.project(shots.faces[1]), gradient, np.array([2, 0]))
    assert np.allclose(few, every[[*range(6), 8, 6]], rtol=1e-5, atol=1e-3)


def test_a_step_keeps_actuators_in_range_and_the_rotation_of_unit_length(shots: Shots) -> None:
    step = np.full(6 + len(EAUS), 0.9)
    face = apply_increment(apply_increment(shots.faces[0], step), step)
    assert np.linalg.norm(face.pose.rotation) == pytest.approx(1)
    assert all(eau.low <= value <= eau.high for eau, value in zip(EAUS, face.eau, strict=True))


def test_a_negative_activation_uses_its_own_field(shots: Shots, shape: ShapeFreeFrame) -> None:
    lowered = np.zeros(len(EAUS))
    lowered[EAU_INDEX["mouth_corners"]] = -0.5
    face = replace(shots.faces[0], eau=lowered)
    expected = pixel_from_head(
        shots.camera, face.pose, shape.atlas.points(shots.face.animate(lowered))
    )
    assert np.abs(shape.positions(face) - expected).max() < 0.01
