"""What modes leave of frames is what least squares leaves, however frames and modes came."""

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.learning.orthogonal_residual import OrthogonalResidual

Single = NDArray[np.float32]


def some(seed: int, count: int) -> Single:
    return np.asarray(np.random.default_rng(seed).normal(size=(count, 90)), np.float32)


def left_over(frames: Single, modes: Single) -> Single:
    left = frames - np.linalg.lstsq(modes.T, frames.T, rcond=None)[0].T @ modes
    return np.asarray(left, np.float32)


def test_modes_leave_what_least_squares_leaves() -> None:
    frames, modes = some(4, 12), some(5, 5)
    remainder = OrthogonalResidual(frames)
    assert remainder.weighted_energy() == pytest.approx(float((frames**2).sum()), rel=1e-5)
    for mode in modes:
        remainder.add_mode(mode)
    left = left_over(frames, modes)
    assert remainder.weighted_energy() == pytest.approx(float((left**2).sum()), rel=1e-4)
    energies = np.log2((left**2).sum(1))
    assert remainder.mean_log_energy == pytest.approx(float(energies.mean()), abs=1e-4)


def test_frames_that_come_and_go_leave_those_between() -> None:
    frames, modes = some(6, 9), some(7, 4)
    remainder = OrthogonalResidual(frames[:3])
    remainder.add_mode(modes[0])
    for frame in frames[3:]:
        remainder.add_frame(frame)
    for mode in modes[1:]:
        remainder.add_mode(mode)
    remainder.drop_oldest_frame()
    remainder.add_mode(some(1, 1)[0])
    remainder.remove_last_mode()
    remainder.drop_oldest_frame()
    assert len(remainder) == 7
    left = left_over(frames[2:], modes)
    assert remainder.weighted_energy() == pytest.approx(float((left**2).sum()), rel=1e-4)


@pytest.mark.parametrize("weights", [1.0, np.linspace(0.2, 1, 12)])
def test_the_strongest_direction_holds_the_share_it_says(
    weights: NDArray[np.float64] | float,
) -> None:
    frames, modes = some(8, 12), some(9, 3)
    remainder = OrthogonalResidual(frames)
    for mode in modes:
        remainder.add_mode(mode)
    direction, share = remainder.leading_direction(weights)
    assert np.abs(modes @ direction).max() < 1e-3 * np.linalg.norm(direction)
    left = left_over(frames, modes) * np.broadcast_to(weights, 12)[:, None]
    along = left @ direction / np.linalg.norm(direction)
    assert float(along @ along) == pytest.approx(share * float((left**2).sum()), rel=1e-3)
    assert np.linalg.norm(direction) == pytest.approx(float(np.sqrt((along**2).mean())), rel=1e-3)
    assert remainder.weighted_energy(weights) == pytest.approx(float((left**2).sum()), rel=1e-4)
    others = np.linalg.svd(left)[1] ** 2
    assert share == pytest.approx(others[0] / others.sum(), rel=1e-3)


def test_what_explains_nothing_and_nothing_to_explain_are_refused() -> None:
    remainder = OrthogonalResidual(some(2, 0))
    with pytest.raises(ValueError, match="no frames"):
        remainder.leading_direction()
    with pytest.raises(ValueError, match="zero everywhere"):
        remainder.add_mode(np.zeros(90, np.float32))
