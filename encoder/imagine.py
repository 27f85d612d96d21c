"""How a caller may go on moving who has been seen for a few seconds only."""

import numpy as np
from numpy.typing import NDArray

from protocol.components import GEOMETRY
from shared_model.parameters import LIDS

Array = NDArray[np.float64]

# How far callers move who have not yet moved: degrees, mm, log depth, actuators.
USUAL_MOTION = np.array([4.0, 4.0, 3.0, 15.0, 15.0, 0.04, *[0.6] * (GEOMETRY - 6)])
# How alike both lids move: a blink then is one component rather than two.
LIDS_ALIKE = 0.95
# Motion is smooth: noise through two low-passes, each of which keeps this much from frame to frame;
# what measuring adds to it, in units of harm.  Both as eight callers' components are predicted.
KEPT = 0.86
MEASURING_UNITS = 0.45
IMAGINED_FRAMES = 400
# The process has forgotten its start after so many.
FIRST_FRAMES = 60


def imagined(vectors: Array, frame_step: int = 1) -> Array:
    """(t, d) how y may go on: a smooth Gaussian process with the moments of y (n, d) so far.

    What has hardly moved yet moves as callers usually do.  frame_step: source frames between two.
    """
    count, d = vectors.shape
    covariance = np.cov(vectors.T).reshape(d, d) if count > 1 else np.zeros((d, d))
    covariance[:GEOMETRY, :GEOMETRY] += usual_covariance()
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(d))
    motion = np.random.default_rng(1).normal(size=(FIRST_FRAMES + IMAGINED_FRAMES, d))
    kept = KEPT**frame_step
    for _ in range(2):
        state = np.zeros(d)
        for row in motion:
            state *= kept
            state += row
            row[:] = state
    motion = motion[FIRST_FRAMES:]
    # The variance of such a process.
    motion *= np.sqrt((1 - kept**2) ** 3 / (1 + kept**2))
    return np.asarray(vectors.mean(0) + motion @ root.T)


def usual_covariance() -> Array:
    """(GEOMETRY, GEOMETRY) of pose and actuators of callers who have not yet moved."""
    left, right = (6 + index for index in LIDS)
    alike = np.eye(GEOMETRY)
    alike[left, right] = alike[right, left] = LIDS_ALIKE
    return np.asarray(alike * np.outer(USUAL_MOTION, USUAL_MOTION) / 4)
