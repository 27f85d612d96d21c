"""Components for motion to come: as large as seen and as usual, and as smooth as they will find."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

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
from shared_model.parameters import LIDS

Array = NDArray[np.float64]

D = GEOMETRY_SIZE + 2
MODES = (b"first", b"second")


def seen(count: int = 60) -> Array:
    rng = np.random.default_rng(3)
    return np.asarray(rng.normal(size=(count, D)) @ rng.normal(size=(D, D)) + 7)


def harm() -> Array:
    rows = np.random.default_rng(1).normal(size=(3 * D, D)) * np.geomspace(1, 30, D)
    return np.asarray(rows.T @ rows / len(rows))


def acted(process: GaussianProcess, frames: int, seed: int) -> Array:
    """(frames, d) a process, by the filter that defines it."""
    d = len(process.covariance)
    state = np.random.default_rng(seed).normal(size=(100 + frames, d))
    for _ in range(2):
        for before, row in pairwise(state):
            row += process.decay * before
    kept = process.decay**2
    state *= np.sqrt((1 - kept) ** 3 / (1 + kept))
    return np.asarray(state[100:] @ np.linalg.cholesky(process.covariance + 1e-9 * np.eye(d)).T)


def test_a_process_is_as_smooth_as_two_low_passes() -> None:
    process = GaussianProcess(np.eye(8), 0.8)
    motion = acted(process, 20_000, 1)
    for frames in (0, 1, 2, 8):
        alike = (motion[frames:] * motion[: len(motion) - frames]).mean()
        assert alike == pytest.approx(process.autocorrelation(frames), abs=0.02)


def test_what_has_not_moved_moves_as_callers_do() -> None:
    still = np.tile(np.arange(D, dtype=float), (5, 1))
    for vectors in (still, still[:1]):
        slow, quick = motion_processes(vectors)
        variance = np.diag(slow.covariance + quick.covariance)
        assert np.sqrt(variance[:GEOMETRY_SIZE]) == pytest.approx(PRIOR_MOTION_2SIGMA / 2)
        assert variance[GEOMETRY_SIZE:] == pytest.approx(0)


def test_what_was_seen_may_go_on_but_for_what_is_alike_by_chance() -> None:
    vectors = seen()
    slow, quick = motion_processes(vectors)
    usual_slow, usual_quick = motion_processes(vectors[:1])
    of_seen = slow.covariance + quick.covariance - usual_slow.covariance - usual_quick.covariance
    measured = np.cov(vectors.T)
    expected = (1 - SHRINKAGE) * measured
    expected[np.diag_indices(D)] = np.diag(measured)
    # What pose and all else have in common is split by the roots of different shares.
    in_common = np.sqrt(POSE_SLOW_SHARE * FACE_SLOW_SHARE) + np.sqrt(
        (1 - POSE_SLOW_SHARE) * (1 - FACE_SLOW_SHARE)
    )
    expected[:6, 6:] *= in_common
    expected[6:, :6] *= in_common
    assert in_common == pytest.approx(0.9, abs=0.01)
    assert of_seen == pytest.approx(expected)


def test_heads_move_more_slowly_than_faces() -> None:
    slow, quick = motion_processes(seen())
    share = np.diag(slow.covariance) / np.diag(slow.covariance + quick.covariance)
    assert slow.decay > quick.decay
    assert share[:6].min() > share[6:].max()


def test_both_lids_close_together() -> None:
    left, right = (6 + index for index in LIDS)
    for process in motion_processes(np.zeros((1, D))):
        both = process.covariance
        alike = both[left, right] / np.sqrt(both[left, left] * both[right, right])
        assert alike == pytest.approx(EYELID_CORRELATION)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_errors_are_those_of_predictions(count: int) -> None:
    frames = np.random.default_rng(2).integers(-999, 999, (count + 1, 5)) * STEPS_PER_UNIT
    found = prediction_error_filters(count)
    assert found[0][0] @ frames == pytest.approx(frames[0])
    assert found[1][0] @ frames == pytest.approx(frames[count] - frames[0])
    known, seen_of_kind = {0: frames[0], count: frames[count]}, [0] * PREDICTION_KINDS
    for place in coding_order(count)[1:]:
        error = frames[place.index] - interpolate(place, known)
        expected = found[place.kind][seen_of_kind[place.kind]] @ frames
        assert expected == pytest.approx(error, abs=1.5)
        known[place.index] = frames[place.index]
        seen_of_kind[place.kind] += 1
    assert all(found)


@pytest.mark.parametrize(("count", "step"), [(8, 1), (4, 2), (1, 8)])
def test_spreads_are_what_such_motion_leaves_to_predictions(count: int, step: int) -> None:
    vectors = seen()
    components = transform_from_prior(vectors, harm(), MODES, count, step)
    assert components.scale_codes.shape == (D, PREDICTION_KINDS)
    slow, quick = motion_processes(vectors)
    motion = acted(slow, 4000, 1) + acted(quick, 4000, 2)
    values = project(components, vectors.mean(0) + motion[::step], harm())
    measured = estimate_scales(values, count).astype(int)
    off = components.scale_codes.astype(int) - measured
    strong = components.scale_codes > 24  # where measuring does not matter
    assert strong.sum() > D
    # Half an octave is 2.
    assert np.abs(off[strong]).mean() < 2
    assert abs(off[strong].mean()) < 0.5


def test_they_are_about_the_mean() -> None:
    components = transform_from_prior(seen(), harm(), MODES, 8, 1)
    # The centre is coded in quarters of a unit.
    assert (np.abs(components.mean - seen().mean(0)) <= components.units / 8 + 1e-9).all()


def test_what_does_not_move_is_measured_with_noise() -> None:
    still = np.tile(np.linspace(1, 2, D), (5, 1))
    components = transform_from_prior(still, np.diag(np.full(D, 400.0)), MODES, 8, 1)
    noise = MEASUREMENT_NOISE * np.random.default_rng(5).normal(size=(8000, 1))
    of_noise = estimate_scales(noise, 8)[0].astype(int)
    assert (np.abs(components.scale_codes[-2:] - of_noise) <= SCALE_CODE_STEP).all()


def test_what_stands_still_has_no_size_below_nothing() -> None:
    modes = tuple(bytes([k]) for k in range(24))
    for seed in range(50):
        rng = np.random.default_rng(seed)
        d = GEOMETRY_SIZE + len(modes)
        rows = rng.normal(size=(3 * d, d)) * np.geomspace(1, 30, d)
        still = np.tile(rng.normal(size=d), (5, 1))
        with np.errstate(all="raise"):
            components = transform_from_prior(still, rows.T @ rows / len(rows), modes, 8, 1)
        assert len(components.basis) == d


def test_nothing_is_left_out_and_the_strongest_are_first() -> None:
    components = transform_from_prior(seen(1), harm(), MODES, 8, 1)
    assert len(components.basis) == D
    size = components.scale_codes[:, 0].astype(int)
    assert size[0] > size[-1]
    # By motion as well as by size: not strictly.
    assert np.diff(size).max() < 8


def test_of_what_is_equally_large_the_quicker_is_first() -> None:
    # Units of pose and of actuators for which both are as large, and nothing else is.
    one_of_each = [0, 6]
    importance = np.full(D, 1e-6)
    importance[one_of_each] = 1e4 / PRIOR_MOTION_2SIGMA[one_of_each] ** 2
    components = transform_from_prior(np.zeros((1, D)), np.diag(importance), MODES, 8, 1)
    assert np.abs(components.matrix).argmax(1)[:2].tolist() == [6, 0]
