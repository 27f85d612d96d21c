"""Values that a fit leaves as they are told: what a hand has set."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aam.shape_space import EAU_SETS, FITTED_EAUS, SHAPE_COUNT, SHAPE_RANGE, actuators
from aam.weak_pose import POSE_COUNT
from shared_model.arrays import Array, Mask
from shared_model.parameters import AAUS


@dataclass(frozen=True, slots=True, eq=False)
class HeldValues:
    """What a fit does not move.

    shape: (25,) AE shape vector, nan where it is fitted.
    pose: (6,) of weak perspective, see `aam.weak_pose`; None: fitted.
    """

    shape: Array
    pose: Array | None

    @classmethod
    def none(cls) -> Self:
        """All is fitted."""
        return cls(np.full(SHAPE_COUNT, np.nan), None)

    @classmethod
    def of_options(cls, text: str) -> Self:
        """What the options of an annotation leave at rest, see `eaus_option`."""
        held = cls.none()
        for name, fitted in EAU_SETS.items():
            if eaus_option(name) in text.split():
                at_rest = [index for index in FITTED_EAUS if index not in fitted]
                held.shape[[len(AAUS) + index for index in at_rest]] = 0
        return held

    def start(self) -> tuple[Array, Array]:
        """AAUs (11,) and EAUs (14,) where a fit starts: as held, else at rest."""
        return actuators(np.where(np.isnan(self.shape), 0.0, self.shape))

    def applied(self, eau: Array) -> Array:
        """EAUs (14,) with the held ones as they are held."""
        held = self.shape[len(AAUS) :]
        return np.where(np.isnan(held), eau, held * SHAPE_RANGE[len(AAUS) :])

    def free(self, controls: int) -> Mask:
        """(n,) what is fitted of AAUs, controls, the fitted EAUs, rotation, x, y, log scale.

        controls: number of values of the residual shape.
        """
        free = np.isnan(self.shape)
        aau, eau = free[: len(AAUS)], free[len(AAUS) :][np.array(FITTED_EAUS)]
        pose = np.full(POSE_COUNT, self.pose is None)
        return np.concatenate([aau, np.ones(controls, bool), eau, pose])


def eaus_option(name: str) -> str:
    """How the options of an annotation name one of `EAU_SETS`."""
    return f"eaus={name}"
