"""The anthropometric-expression (AE) shape space (thesis 2.4.1): AAUs and EAUs in [-1, 1]."""

from collections.abc import Mapping

import numpy as np

from encoder.fitting.increments import AAU_LIMIT
from shared_model.arrays import Array
from shared_model.parameters import AAUS, EAU_HIGH, EAU_INDEX, EAU_LOW, EAUS, THESIS_EAUS

SHAPE_NAMES = (*AAUS, *(eau.name for eau in EAUS))
SHAPE_COUNT = len(SHAPE_NAMES)
# What an actuator is divided by; rest is 0.
SHAPE_RANGE = np.concatenate(
    [np.full(len(AAUS), AAU_LIMIT), np.maximum(np.abs(EAU_LOW), np.abs(EAU_HIGH))]
)
# The gaze is not fitted: landmarks show it by the lids alone.
FITTED_EAUS = tuple(i for i, eau in enumerate(EAUS) if not eau.name.startswith("gaze"))
# The actuators that annotations may fit: all, or the four of the thesis' tracking model (5.3).
EAU_SETS: Mapping[str, tuple[int, ...]] = {
    "all": FITTED_EAUS,
    "thesis": tuple(EAU_INDEX[name] for name in THESIS_EAUS),
}
LOW = np.concatenate([np.full(len(AAUS), -1.0), np.array(EAU_LOW)])
HIGH = np.concatenate([np.full(len(AAUS), 1.0), np.array(EAU_HIGH)])


def shape_vector(aau: Array, eau: Array) -> Array:
    """The AE shape vector (25,) of AAUs (11,) and EAUs (14,), each in [-1, 1]."""
    return np.asarray(np.clip(np.concatenate([aau, eau]) / SHAPE_RANGE, -1, 1))


def actuators(shape: Array) -> tuple[Array, Array]:
    """AAUs (11,) and EAUs (14,) of a shape vector (25,); EAUs beyond their ranges are clipped."""
    values = np.clip(shape, LOW, HIGH) * SHAPE_RANGE
    return values[: len(AAUS)], values[len(AAUS) :]


def mirrored(shape: Array) -> Array:
    """The shape vector (25,) of the mirror image of a face."""
    lids = [len(AAUS) + EAU_INDEX[name] for name in ("lid_left", "lid_right")]
    flipped = np.array(shape)
    flipped[lids] = flipped[lids[::-1]]
    flipped[len(AAUS) + EAU_INDEX["gaze_horizontal"]] *= -1
    return flipped
