"""The muscles one by one, those of the left and of the right apart (thesis 5.4.1).

They are no actuators of a call: an EAU is sent, and moves several muscles on both sides.
"""

import numpy as np

from shared_model.anatomy.expressions import anatomy_of, overlapped
from shared_model.anatomy.muscle_table import MUSCLES, UNPAIRED
from shared_model.anatomy.muscles import Muscle
from shared_model.arrays import Array
from shared_model.mesh import Head

# Sides are the subject's.
SIDES = ("left", "right")


def side_names(muscle: Muscle) -> tuple[str, ...]:
    """The names of a muscle's contractions: "risorius_left", "risorius_right", or "procerus"."""
    name = muscle.name.replace(" ", "_")
    return (name,) if muscle in UNPAIRED else tuple(f"{name}_{side}" for side in SIDES)


MUSCLE_NAMES = tuple(name for muscle in MUSCLES for name in side_names(muscle))


class MuscleFields:
    """The displacement fields of the muscles of a head, by `MUSCLE_NAMES`.

    They are those of the generic shape, as the fields of the EAUs are.
    """

    def __init__(self, head: Head) -> None:
        anatomy = anatomy_of(head.vertices, head.triangles, head.parts, head.landmarks)
        self._sides = {
            muscle.name: [
                muscle.displacement(anatomy.vertices, anatomy.points, side)
                for side in ("l", "r")[: len(side_names(muscle))]
            ]
            for muscle in MUSCLES
        }
        self._reach = {muscle.name: anatomy.reach(muscle)[:, None] for muscle in MUSCLES}
        self._shape = head.vertices.shape

    def displacement(self, contractions: Array) -> Array:
        """(n, 3) mm of contractions (len(MUSCLE_NAMES),), 0 at rest, 1 full.

        Both sides of a pair at 1 are what an EAU pulls.
        """
        strength = dict(zip(MUSCLE_NAMES, contractions, strict=True))
        total = np.zeros(self._shape)
        for muscle in MUSCLES:
            strengths = [strength[name] for name in side_names(muscle)]
            if any(strengths):
                pairs = zip(strengths, self._sides[muscle.name], strict=True)
                sides = [share * field for share, field in pairs]
                field = overlapped(*sides) if len(sides) == 2 else sides[0]
                total += field * self._reach[muscle.name]
        return total
