"""The incremental residual is the least-squares residual, in any order of updates."""

import numpy as np
import pytest

from encoder.learning.orthogonal_residual import OrthogonalResidual
from shared_model.arrays import Array, Single


def random_rows(seed: int, count: int) -> Single:
    return np.asarray(np.random.default_rng(seed).normal(size=(count, 90)), np.float32)


def least_squares_residual(frames: Single, modes: Single) -> Single:
    expected = frames - np.linalg.lstsq(modes.T, frames.T, rcond=None)[0].T @ modes
    return np.asarray(expected, np.float32)


def test_the_residual_is_that_of_least_squares() -> None:
    frames, modes = random_rows(4, 12), random_rows(5, 5)
    residual = OrthogonalResidual(frames)
    assert residual.weighted_energy() == pytest.approx(float((frames**2).sum()), rel=1e-5)
    for mode in modes:
        residual.add_mode(mode)
    expected = least_squares_residual(frames, modes)
    assert residual.weighted_energy() == pytest.approx(float((expected**2).sum()), rel=1e-4)
    energies = np.log2((expected**2).sum(1))
    assert residual.mean_log_energy == pytest.approx(float(energies.mean()), abs=1e-4)


def test_added_and_dropped_frames_leave_the_residual_of_the_others() -> None:
    frames, modes = random_rows(6, 9), random_rows(7, 4)
    residual = OrthogonalResidual(frames[:3])
    residual.add_mode(modes[0])
    for frame in frames[3:]:
        residual.add_frame(frame)
    for mode in modes[1:]:
        residual.add_mode(mode)
    residual.drop_oldest_frame()
    residual.add_mode(random_rows(1, 1)[0])
    residual.remove_last_mode()
    residual.drop_oldest_frame()
    assert len(residual) == 7
    expected = least_squares_residual(frames[2:], modes)
    assert residual.weighted_energy() == pytest.approx(float((expected**2).sum()), rel=1e-4)


@pytest.mark.parametrize("weights", [1.0, np.linspace(0.2, 1, 12)])
def test_the_leading_direction_is_the_first_principal_one(
    weights: Array | float,
) -> None:
    frames, modes = random_rows(8, 12), random_rows(9, 3)
    residual = OrthogonalResidual(frames)
    for mode in modes:
        residual.add_mode(mode)
    direction, share = residual.leading_direction(weights)
    assert np.abs(modes @ direction).max() < 1e-3 * np.linalg.norm(direction)
    expected = least_squares_residual(frames, modes) * np.broadcast_to(weights, 12)[:, None]
    projected = expected @ direction / np.linalg.norm(direction)
    assert float(projected @ projected) == pytest.approx(
        share * float((expected**2).sum()), rel=1e-3
    )
    assert np.linalg.norm(direction) == pytest.approx(
        float(np.sqrt((projected**2).mean())), rel=1e-3
    )
    assert residual.weighted_energy(weights) == pytest.approx(float((expected**2).sum()), rel=1e-4)
    others = np.linalg.svd(expected)[1] ** 2
    assert share == pytest.approx(others[0] / others.sum(), rel=1e-3)


def test_the_newest_frame_can_be_taken_back() -> None:
    frames, modes = random_rows(3, 6), random_rows(4, 2)
    residual = OrthogonalResidual(frames[:5])
    for mode in modes:
        residual.add_mode(mode)
    before = residual.energies
    residual.add_frame(frames[5])
    expected = (least_squares_residual(frames, modes) ** 2).sum(1)
    np.testing.assert_allclose(residual.energies, expected, rtol=1e-3)
    residual.drop_newest_frame()
    np.testing.assert_allclose(residual.energies, before)


def test_a_zero_mode_and_an_empty_residual_are_refused() -> None:
    residual = OrthogonalResidual(random_rows(2, 0))
    with pytest.raises(ValueError, match="no frames"):
        residual.leading_direction()
    with pytest.raises(ValueError, match="zero everywhere"):
        residual.add_mode(np.zeros(90, np.float32))
