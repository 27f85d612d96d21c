"""Imagined motion: as large as what was seen and as callers usually move, and as smooth."""

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.imagine import (
    IMAGINED_FRAMES,
    KEPT,
    LIDS_ALIKE,
    USUAL_MOTION,
    imagined,
    usual_covariance,
)
from protocol.components import GEOMETRY
from shared_model.parameters import EAU_INDEX, LID_EAUS

D = GEOMETRY + 2


def seen(count: int = 60) -> NDArray[np.float64]:
    rng = np.random.default_rng(3)
    return np.asarray(rng.normal(size=(count, D)) @ rng.normal(size=(D, D)) + 7)


def whitened(vectors: NDArray[np.float64], frame_step: int = 1) -> NDArray[np.float64]:
    """(t, d) imagined motion about its mean, by the covariance that it should have."""
    covariance = np.cov(vectors.T)
    covariance[:GEOMETRY, :GEOMETRY] += usual_covariance()
    made = imagined(vectors, frame_step)
    assert made.shape == (IMAGINED_FRAMES, D)
    root = np.linalg.cholesky(covariance)
    return np.asarray(np.linalg.solve(root, (made - vectors.mean(0)).T).T)


def test_it_has_the_covariance_of_what_was_seen_and_what_is_usual() -> None:
    # So far apart that frames tell hardly anything of the next.
    white = whitened(seen(), frame_step=20)
    covariance = white.T @ white / len(white)
    assert np.diag(covariance).mean() == pytest.approx(1, abs=0.05)
    assert np.abs(covariance - np.eye(D)).max() < 0.35
    assert np.abs(white.mean(0)).max() < 0.3


@pytest.mark.parametrize("frame_step", [1, 2, 8])
def test_it_is_as_smooth_as_two_low_passes(frame_step: int) -> None:
    white, kept = whitened(seen(), frame_step), KEPT**frame_step
    power = (white**2).mean()
    assert power == pytest.approx(1, abs=0.3)
    alike = (white[1:] * white[:-1]).mean() / power
    assert alike == pytest.approx(2 * kept / (1 + kept**2), abs=0.03)


def test_what_has_not_moved_moves_as_callers_do() -> None:
    still = np.tile(np.arange(D, dtype=float), (5, 1))
    for vectors in (still, still[:1]):
        spread = (imagined(vectors, 20) - vectors.mean(0)).std(0)
        assert spread[:GEOMETRY] == pytest.approx(USUAL_MOTION / 2, rel=0.2)
        assert (spread[GEOMETRY:] < 1e-3).all()


def test_both_lids_close_together() -> None:
    left, right = (6 + EAU_INDEX[name] for name in LID_EAUS)
    covariance = np.cov(imagined(np.zeros((1, D)), 20).T).reshape(D, D)
    alike = covariance[left, right] / np.sqrt(covariance[left, left] * covariance[right, right])
    assert alike == pytest.approx(LIDS_ALIKE, abs=0.02)
