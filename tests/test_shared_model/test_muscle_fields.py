"""Muscles one by one: each on its own side, and both together what the actuators pull."""

import numpy as np
import pytest

from shared_model.anatomy import muscle_table as table
from shared_model.anatomy.expressions import anatomy_of
from shared_model.anatomy.muscle_fields import MUSCLE_NAMES, MuscleFields, side_names
from shared_model.anatomy.muscles import Muscle
from shared_model.arrays import Array
from shared_model.mesh import generic_head

HEAD = generic_head()


@pytest.fixture(scope="module")
def fields() -> MuscleFields:
    return MuscleFields(HEAD)


def contracted(**strengths: float) -> Array:
    return np.array([strengths.get(name, 0.0) for name in MUSCLE_NAMES])


def test_muscles_are_pairs_and_those_on_the_midline_have_no_side() -> None:
    assert len(set(MUSCLE_NAMES)) == len(MUSCLE_NAMES)
    assert [name for name in MUSCLE_NAMES if not name.endswith(("_left", "_right"))] == [
        "orbicularis_oris",
        "procerus",
    ]


@pytest.mark.parametrize("muscle", table.MUSCLES, ids=lambda m: m.name)
def test_both_sides_are_what_an_actuator_pulls(muscle: Muscle, fields: MuscleFields) -> None:
    anatomy = anatomy_of(HEAD.vertices, HEAD.triangles, HEAD.parts, HEAD.landmarks)
    found = fields.displacement(contracted(**dict.fromkeys(side_names(muscle), 1.0)))
    np.testing.assert_allclose(found, anatomy.pull((muscle, 1.0)), atol=1e-6)
    assert np.linalg.norm(found, axis=1).max() > 2


def test_a_muscle_pulls_its_own_side_and_by_its_contraction(fields: MuscleFields) -> None:
    left = fields.displacement(contracted(zygomatic_major_left=1.0))
    moved = np.linalg.norm(left, axis=1) > 0.5
    assert moved.any() and HEAD.vertices[moved, 0].min() > -20
    half = fields.displacement(contracted(zygomatic_major_left=0.5))
    np.testing.assert_allclose(half, left / 2)
    right = fields.displacement(contracted(zygomatic_major_right=1.0))
    assert HEAD.vertices[np.linalg.norm(right, axis=1) > 0.5, 0].max() < 20
    assert not fields.displacement(contracted()).any()
