"""A face is its neutral shape plus every actuator's field times its drive (eq. 2.10)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared_model.animate import Face, Identity, identity_from_controls
from shared_model.arrays import Array
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAUS
from shared_model.shape_residual import control_points

HEAD = generic_head()
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))


def drive(index: int, value: float) -> Array:
    eau = np.zeros(len(EAUS))
    eau[index] = value
    return eau


@given(st.integers(0, len(EAUS) - 1), st.floats(0, 1), st.sampled_from([-1, 1]))
def test_displacements_are_linear_in_the_contraction(index: int, share: float, sign: int) -> None:
    full = FACE.animate(drive(index, sign)) - HEAD.vertices
    part = FACE.animate(drive(index, share * sign)) - HEAD.vertices
    np.testing.assert_allclose(part, share * full, atol=1e-9)


def test_actuators_add_up() -> None:
    rng = np.random.default_rng(3)
    eau = rng.uniform(-1, 1, len(EAUS))
    alone = [FACE.animate(drive(i, value)) - HEAD.vertices for i, value in enumerate(eau)]
    np.testing.assert_allclose(FACE.animate(eau) - HEAD.vertices, sum(alone), atol=1e-9)


def test_identity_and_expression_do_not_mix() -> None:
    rng = np.random.default_rng(4)
    control_mm = rng.normal(0, 2, (len(control_points(HEAD)), 3))
    identity = identity_from_controls(HEAD, rng.uniform(-1, 1, len(AAUS)), control_mm)
    other, eau = Face(HEAD, identity), rng.uniform(0, 1, len(EAUS))
    moved = other.animate(eau) - other.neutral
    np.testing.assert_allclose(moved, FACE.animate(eau) - HEAD.vertices, atol=1e-9)
    assert np.abs(other.neutral - HEAD.vertices).max() > 3


def test_a_reshaped_face_has_the_aaus_of_both_and_leaves_the_first_alone() -> None:
    first, change = np.full(len(AAUS), 0.25), np.linspace(-0.5, 0.5, len(AAUS))
    residual = np.ones_like(HEAD.vertices)
    face = Face(HEAD, Identity(first, residual))
    before = face.neutral.copy()
    expected = Face(HEAD, Identity(first + change, residual))
    np.testing.assert_allclose(face.with_aau_offset(change).neutral, expected.neutral, atol=1e-9)
    np.testing.assert_array_equal(face.neutral, before)


def test_some_vertices_alone_move_as_they_do_among_all() -> None:
    index = np.array([7, 1200, 3])
    eau = np.linspace(-0.4, 0.6, len(EAUS))
    assert FACE.at_vertices(index).animate(eau) == pytest.approx(FACE.animate(eau)[index])
    assert np.array_equal(FACE.at_vertices(index).neutral, FACE.neutral[index])


def test_vectors_of_another_length_are_refused() -> None:
    with pytest.raises(ValueError, match="eau has shape"):
        FACE.animate(np.zeros(3))
    with pytest.raises(ValueError, match="aau has shape"):
        Face(HEAD, Identity(np.zeros(3), np.zeros_like(HEAD.vertices)))
