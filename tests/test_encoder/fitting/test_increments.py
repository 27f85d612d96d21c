"""Increments of faces and identities: they add up, and are clipped where they are too long."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import generic_identity
from encoder.fitting.increments import (
    FACE_PARAMETERS,
    STEP_LIMITS,
    apply_clipped_increment,
    apply_identity_increment,
    apply_increment,
    apply_picture_step,
    identity_increment_between,
    identity_room,
    shared_parameter_count,
)
from shared_model.geometry import pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import EAUS, FaceParameters

HEAD = generic_head()
FACE = FaceParameters(pose_from_euler(5, -20, 10, np.array([30.0, -20.0, 600.0])))
GENERIC = generic_identity(HEAD, (640, 480))
PERSON = IdentityFit(GENERIC.camera, GENERIC.identity, GENERIC.control_mm, (FACE,))


@given(st.integers(0, 2**32 - 1))
def test_an_identity_increment_is_recovered_from_both_identities(seed: int) -> None:
    random = np.random.default_rng(seed)
    step = random.uniform(-0.1, 0.1, shared_parameter_count(PERSON) + FACE_PARAMETERS)
    step[-len(EAUS) :] = 0
    moved = apply_identity_increment(HEAD, PERSON, step)
    np.testing.assert_allclose(identity_increment_between(PERSON, moved), step, atol=1e-9)


def test_a_longer_lens_keeps_the_size_of_the_face() -> None:
    step = np.zeros(shared_parameter_count(PERSON) + FACE_PARAMETERS)
    step[0] = 0.1
    moved = apply_identity_increment(HEAD, PERSON, step)
    sizes = [
        person.camera.focal_px / person.frames[0].pose.translation_mm[2]
        for person in (PERSON, moved)
    ]
    assert moved.camera.focal_px > 1.1 * PERSON.camera.focal_px
    np.testing.assert_allclose(*sizes)


def test_a_step_within_its_room_is_taken_whole_and_a_longer_one_is_not() -> None:
    for end in identity_room(PERSON):
        step = np.where(np.isfinite(end), end, np.sign(end))
        moved = apply_identity_increment(HEAD, PERSON, step)
        np.testing.assert_allclose(identity_increment_between(PERSON, moved), step, atol=1e-9)
        longer = apply_identity_increment(HEAD, PERSON, np.where(np.isfinite(end), 1.1 * end, step))
        np.testing.assert_allclose(identity_increment_between(PERSON, longer), step, atol=1e-9)


def test_a_long_rotation_is_clipped_and_a_short_one_is_not() -> None:
    short, long = np.zeros(FACE_PARAMETERS), np.zeros(FACE_PARAMETERS)
    short[1], long[1] = STEP_LIMITS[1] / 2, 3 * STEP_LIMITS[1]
    np.testing.assert_array_equal(
        apply_clipped_increment(FACE, short).pose.rotation,
        apply_increment(FACE, short).pose.rotation,
    )
    np.testing.assert_array_equal(
        apply_clipped_increment(FACE, long).pose.rotation,
        apply_increment(FACE, np.clip(long, -STEP_LIMITS, STEP_LIMITS)).pose.rotation,
    )


def test_a_picture_step_adds_active_actuators_and_replaces_coefficients() -> None:
    active = np.array([2, 5])
    solution = np.concatenate([np.zeros(6), [0.2, 0.1], [7.0, 8.0, 9.0]])
    moved = apply_picture_step(FACE, solution, active)
    expected = np.zeros(len(EAUS))
    expected[active] = 0.2, 0.1
    np.testing.assert_allclose(moved.eau, expected)
    np.testing.assert_array_equal(moved.modes, [7.0, 8.0, 9.0])
