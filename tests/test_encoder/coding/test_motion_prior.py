"""The motion prior: its covariance, its smoothness, and the transform designed from it."""

from itertools import pairwise

import numpy as np
import pytest

from encoder.coding.motion_prior import (
    EYELID_CORRELATION,
    FACE_SLOW_SHARE,
    MEASUREMENT_NOISE,
    POSE_SLOW_SHARE,
    PRIOR_MOTION_2SIGMA,
    SHRINKAGE,
    GaussianProcess,
    motion_processes,
    prediction_error_filters,
    transform_from_prior,
)
from encoder.coding.transform import estimate_scales, project
from protocol.frames.frame_transform import GEOMETRY_SIZE, SCALE_CODE_STEP
from protocol.frames.temporal_prediction import (
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    coding_order,
    interpolate,
)
from shared_model.arrays import Array
from shared_model.parameters import LIDS

D = GEOMETRY_SIZE + 2
MODES = (b"first", b"second")


def sample(count: int = 60) -> Array:
    rng = np.random.default_rng(3)
    return np.asarray(rng.normal(size=(count, D)) @ rng.normal(size=(D, D)) + 7)


def distortion() -> Array:
    rows = np.random.default_rng(1).normal(size=(3 * D, D)) * np.geomspace(1, 30, D)
    return np.asarray(rows.T @ rows / len(rows))


def sampled_motion(process: GaussianProcess, frames: int, seed: int) -> Array:
    """(frames, d) a realisation of a process, by the filter that defines it."""
    d = len(process.covariance)
    state = np.random.default_rng(seed).normal(size=(100 + frames, d))
    for _ in range(2):
        for before, row in pairwise(state):
            row += process.decay * before
    squared_decay = process.decay**2
    state *= np.sqrt((1 - squared_decay) ** 3 / (1 + squared_decay))
    return np.asarray(state[100:] @ np.linalg.cholesky(process.covariance + 1e-9 * np.eye(d)).T)


def test_the_autocorrelation_is_that_of_two_low_passes() -> None:
    process = GaussianProcess(np.eye(8), 0.8)
    motion = sampled_motion(process, 20_000, 1)
    for frames in (0, 1, 2, 8):
        correlation = (motion[frames:] * motion[: len(motion) - frames]).mean()
        assert correlation == pytest.approx(process.autocorrelation(frames), abs=0.02)


def test_a_motionless_sample_has_the_prior_covariance() -> None:
    motionless = np.tile(np.arange(D, dtype=float), (5, 1))
    for vectors in (motionless, motionless[:1]):
        slow, fast = motion_processes(vectors)
        variance = np.diag(slow.covariance + fast.covariance)
        assert np.sqrt(variance[:GEOMETRY_SIZE]) == pytest.approx(PRIOR_MOTION_2SIGMA / 2)
        assert variance[GEOMETRY_SIZE:] == pytest.approx(0)


def test_the_sample_covariance_is_shrunk_and_added_to_the_prior() -> None:
    vectors = sample()
    slow, fast = motion_processes(vectors)
    prior_slow, prior_fast = motion_processes(vectors[:1])
    from_sample = slow.covariance + fast.covariance - prior_slow.covariance - prior_fast.covariance
    measured = np.cov(vectors.T)
    expected = (1 - SHRINKAGE) * measured
    expected[np.diag_indices(D)] = np.diag(measured)
    # The cross-covariance of pose and the rest is split by roots of different shares.
    common_share = np.sqrt(POSE_SLOW_SHARE * FACE_SLOW_SHARE) + np.sqrt(
        (1 - POSE_SLOW_SHARE) * (1 - FACE_SLOW_SHARE)
    )
    expected[:6, 6:] *= common_share
    expected[6:, :6] *= common_share
    assert common_share == pytest.approx(0.9, abs=0.01)
    assert from_sample == pytest.approx(expected)


def test_heads_move_more_slowly_than_faces() -> None:
    slow, fast = motion_processes(sample())
    share = np.diag(slow.covariance) / np.diag(slow.covariance + fast.covariance)
    assert slow.decay > fast.decay
    assert share[:6].min() > share[6:].max()


def test_both_eyelids_are_correlated() -> None:
    left, right = (6 + index for index in LIDS)
    for process in motion_processes(np.zeros((1, D))):
        both = process.covariance
        correlation = both[left, right] / np.sqrt(both[left, left] * both[right, right])
        assert correlation == pytest.approx(EYELID_CORRELATION)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_the_filters_give_the_errors_of_the_predictions(count: int) -> None:
    frames = np.random.default_rng(2).integers(-999, 999, (count + 1, 5)) * STEPS_PER_UNIT
    filters = prediction_error_filters(count)
    assert filters[0][0] @ frames == pytest.approx(frames[0])
    assert filters[1][0] @ frames == pytest.approx(frames[count] - frames[0])
    known, count_of_kind = {0: frames[0], count: frames[count]}, [0] * PREDICTION_KINDS
    for coded_frame in coding_order(count)[1:]:
        error = frames[coded_frame.index] - interpolate(coded_frame, known)
        expected = filters[coded_frame.kind][count_of_kind[coded_frame.kind]] @ frames
        assert expected == pytest.approx(error, abs=1.5)
        known[coded_frame.index] = frames[coded_frame.index]
        count_of_kind[coded_frame.kind] += 1
    assert all(filters)


@pytest.mark.parametrize(("count", "step"), [(8, 1), (4, 2), (1, 8)])
def test_scale_codes_are_those_of_the_prediction_errors_of_such_motion(
    count: int, step: int
) -> None:
    vectors = sample()
    transform = transform_from_prior(vectors, distortion(), MODES, count, step)
    assert transform.scale_codes.shape == (D, PREDICTION_KINDS)
    slow, fast = motion_processes(vectors)
    motion = sampled_motion(slow, 4000, 1) + sampled_motion(fast, 4000, 2)
    values = project(transform, vectors.mean(0) + motion[::step], distortion())
    measured = estimate_scales(values, count).astype(int)
    difference = transform.scale_codes.astype(int) - measured
    large = transform.scale_codes > 24  # where measurement noise does not matter
    assert large.sum() > D
    # Half an octave is 2.
    assert np.abs(difference[large]).mean() < 2
    assert abs(difference[large].mean()) < 0.5


def test_the_transform_is_about_the_mean() -> None:
    transform = transform_from_prior(sample(), distortion(), MODES, 8, 1)
    # The mean is coded in quarters of a unit.
    assert (np.abs(transform.mean - sample().mean(0)) <= transform.units / 8 + 1e-9).all()


def test_a_motionless_mode_has_the_scale_of_the_measurement_noise() -> None:
    motionless = np.tile(np.linspace(1, 2, D), (5, 1))
    transform = transform_from_prior(motionless, np.diag(np.full(D, 400.0)), MODES, 8, 1)
    noise = MEASUREMENT_NOISE * np.random.default_rng(5).normal(size=(8000, 1))
    noise_codes = estimate_scales(noise, 8)[0].astype(int)
    assert (np.abs(transform.scale_codes[-2:] - noise_codes) <= SCALE_CODE_STEP).all()


def test_a_motionless_sample_has_no_negative_variance() -> None:
    modes = tuple(bytes([k]) for k in range(24))
    for seed in range(50):
        rng = np.random.default_rng(seed)
        d = GEOMETRY_SIZE + len(modes)
        rows = rng.normal(size=(3 * d, d)) * np.geomspace(1, 30, d)
        motionless = np.tile(rng.normal(size=d), (5, 1))
        with np.errstate(all="raise"):
            transform = transform_from_prior(motionless, rows.T @ rows / len(rows), modes, 8, 1)
        assert len(transform.basis) == d


def test_all_components_are_sent_the_largest_first() -> None:
    transform = transform_from_prior(sample(1), distortion(), MODES, 8, 1)
    assert len(transform.basis) == D
    size = transform.scale_codes[:, 0].astype(int)
    assert size[0] > size[-1]
    # The order depends on motion as well as on size.
    assert np.diff(size).max() < 8


def test_of_equally_large_components_the_faster_is_first() -> None:
    # Weights by which a rotation and an EAU are equally large, and the others are negligible.
    rotation_and_eau = [0, 6]
    weights = np.full(D, 1e-6)
    weights[rotation_and_eau] = 1e4 / PRIOR_MOTION_2SIGMA[rotation_and_eau] ** 2
    transform = transform_from_prior(np.zeros((1, D)), np.diag(weights), MODES, 8, 1)
    assert np.abs(transform.matrix).argmax(1)[:2].tolist() == [6, 0]
