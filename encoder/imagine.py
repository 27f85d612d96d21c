"""How a caller may go on moving who has been seen for a few seconds only."""

import numpy as np
from numpy.typing import NDArray

from protocol.components import GEOMETRY

Array = NDArray[np.float64]

# How far callers move who have not yet moved: degrees, mm, log depth, actuators.
USUAL_MOTION = np.array([4.0, 4.0, 3.0, 15.0, 15.0, 0.04, *[0.12] * (GEOMETRY - 6)])
CORRELATION = 0.95
IMAGINED_FRAMES = 400


def imagined(vectors: Array, frame_step: int = 1) -> Array:
    """(t, d) how y may go on: a Gauss-Markov process with the moments of y (n, d) so far.

    What has hardly moved yet moves as callers usually do.  frame_step: source frames between two.
    """
    count, d = vectors.shape
    covariance = np.cov(vectors.T).reshape(d, d) if count > 1 else np.zeros((d, d))
    usual = np.zeros(d)
    usual[:GEOMETRY] = USUAL_MOTION**2 / 4
    correlation = CORRELATION**frame_step
    root = np.linalg.cholesky(covariance + np.diag(usual + 1e-9))
    noise = np.random.default_rng(1).normal(size=(IMAGINED_FRAMES, d))
    state, rows = noise[0], []
    for fresh in noise:
        state = correlation * state + np.sqrt(1 - correlation**2) * fresh
        rows.append(vectors.mean(0) + root @ state)
    return np.array(rows)
