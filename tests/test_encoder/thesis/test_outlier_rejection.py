"""Robust residuals identify points that move unlike the majority."""

import numpy as np
import pytest

from encoder.thesis.outlier_rejection import IRLS_ROUNDS, MEDIAN_RMS, robust_residuals

RANDOM = np.random.default_rng(3)
POINTS, STATE, MOVED = 30, 9, 4


class Scene:
    """Measurements of a state by points, which depend on its first entries, and otherwise.

    gone: how many points follow another state.  hidden: (n,) bool.
    """

    def __init__(self, gone: int = 0) -> None:
        self.H = RANDOM.normal(size=(2 * POINTS, MOVED))
        self.innovation = self.H @ [1.0, -2, 0.5, 1] + RANDOM.normal(0, 0.1, 2 * POINTS)
        self.innovation[: 2 * gone] -= 5
        self.hidden = np.arange(POINTS) % 5 == 4
        self.weight = np.where(np.repeat(self.hidden, 2), 0, 1 / 0.1**2)
        root = RANDOM.normal(size=(STATE, STATE))
        self.known = root @ root.T + np.eye(STATE)
        self.towards = RANDOM.normal(size=STATE)

    def distances(self) -> tuple[np.ndarray, float]:
        return robust_residuals(
            self.known, self.towards, self.H, self.innovation, self.weight, ~self.hidden
        )


def by_matrices(scene: Scene) -> tuple[np.ndarray, float]:
    """Reference implementation with the matrices of all measurements and the whole state."""
    H = np.hstack([scene.H, np.zeros((2 * POINTS, STATE - MOVED))])
    trial = scene.weight.copy()
    for _ in range(IRLS_ROUNDS):
        J = H * trial[:, None]
        step = np.linalg.solve(scene.known + J.T @ H, scene.towards + J.T @ scene.innovation)
        left = scene.innovation - H @ step
        off = np.sqrt(np.mean((left**2 * scene.weight).reshape(-1, 2), axis=1))
        crowd = max(1.0, float(np.median(off[~scene.hidden])) / MEDIAN_RMS)
        trial = scene.weight / np.repeat(1 + (off / crowd) ** 2, 2)
    return off, crowd


@pytest.mark.parametrize("gone", [0, 4, 12])
def test_residuals_equal_those_of_the_full_equations(gone: int) -> None:
    scene = Scene(gone)
    off, crowd = scene.distances()
    expected_off, expected_crowd = by_matrices(scene)
    assert off == pytest.approx(expected_off, rel=1e-8)
    assert crowd == pytest.approx(expected_crowd, rel=1e-8)


def test_a_minority_that_moves_together_has_large_residuals() -> None:
    scene = Scene(gone=6)
    off, crowd = scene.distances()
    there = ~scene.hidden
    assert (off[:6][there[:6]] > 10 * crowd).all()
    assert (off[6:][there[6:]] < 3.5 * crowd).all()


def test_a_point_without_measurement_has_no_residual() -> None:
    scene = Scene()
    scene.innovation[np.repeat(scene.hidden, 2)] = 1e6
    off, _ = scene.distances()
    assert (off[scene.hidden] == 0).all()
