"""Tracked poses against measured ones, after both are turned to the first frame (thesis 5.3.3).

What is taken for straight ahead differs between a sensor, a template and a model, so that only
turns can be compared.
"""

from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array
from shared_model.geometry import (
    FRONTAL,
    conjugate,
    euler_deg,
    multiply,
    normalise,
    pose_from_euler,
)
from shared_model.parameters import Pose

ANGLES = ("pitch", "yaw", "roll")


@dataclass(frozen=True, slots=True, eq=False)
class PoseComparison:
    """found, truth: (t, 3) pitch, yaw and roll of each frame against the first one in which the
    face was found, degrees; nan where it was not.
    """

    found: Array
    truth: Array

    @property
    def found_share(self) -> float:
        """Share of the frames in which the face was found."""
        return float(np.isfinite(self.found[:, 0]).mean())

    @property
    def mean_deg(self) -> Array:
        """(3,) mean absolute errors, degrees."""
        return np.asarray(np.nanmean(np.abs(self._errors), axis=0))

    @property
    def rms_deg(self) -> Array:
        """(3,) root mean square errors, degrees (eq. 5.1)."""
        return np.asarray(np.sqrt(np.nanmean(self._errors**2, axis=0)))

    @property
    def _errors(self) -> Array:
        return np.asarray((self.found - self.truth + 180) % 360 - 180)


def compare_poses(angles_deg: Array, rotation: Array) -> PoseComparison:
    """Compare tracked angles (t, 3), nan without a face, with true rotations (u, 4).

    Frames that one of both has not are left out.  Raises ValueError if no frame has a face.
    """
    count = min(len(angles_deg), len(rotation))
    tracked, truth = angles_deg[:count], rotation[:count]
    there = np.flatnonzero(np.isfinite(tracked[:, 0]))
    if not len(there):
        raise ValueError("angles_deg has no face, expected one in some frame of both")
    found = np.full((count, 4), np.nan)
    for index in there:
        pitch, yaw, roll = tracked[index]
        found[index] = pose_from_euler(pitch, yaw, roll, np.zeros(3)).rotation
    return PoseComparison(_turns(found, there[0]), _turns(truth, there[0]))


def _turns(rotation: Array, first: int) -> Array:
    """(t, 3) pitch, yaw and roll, degrees, of heads (t, 4) in the axes of the first one's head."""
    origin = conjugate(rotation[first])
    rows = [
        euler_deg(Pose(normalise(multiply(np.array(FRONTAL), multiply(origin, each))), np.zeros(3)))
        if np.isfinite(each).all()
        else (np.nan,) * 3
        for each in rotation
    ]
    return np.array(rows)
