"""Components for motion to come: as large as seen and as usual, and as smooth as they will find."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.combine import measure_spreads, project
from encoder.expect import (
    CHANCE,
    LIDS_ALIKE,
    USUAL_MOTION,
    Process,
    expected_components,
    expected_motion,
    prediction_errors,
)
from protocol.components import GEOMETRY
from protocol.predict import KINDS, UNIT, coding_order, interpolate
from shared_model.parameters import LIDS

Array = NDArray[np.float64]

D = GEOMETRY + 2
MODES = (b"first", b"second")


def seen(count: int = 60) -> Array:
    rng = np.random.default_rng(3)
    return np.asarray(rng.normal(size=(count, D)) @ rng.normal(size=(D, D)) + 7)


def harm() -> Array:
    rows = np.random.default_rng(1).normal(size=(3 * D, D)) * np.geomspace(1, 30, D)
    return np.asarray(rows.T @ rows / len(rows))


def acted(process: Process, frames: int, seed: int) -> Array:
    """(frames, d) a process, by the filter that defines it."""
    d = len(process.covariance)
    state = np.random.default_rng(seed).normal(size=(100 + frames, d))
    for _ in range(2):
        for before, row in pairwise(state):
            row += process.kept * before
    kept = process.kept**2
    state *= np.sqrt((1 - kept) ** 3 / (1 + kept))
    return np.asarray(state[100:] @ np.linalg.cholesky(process.covariance + 1e-9 * np.eye(d)).T)


def test_a_process_is_as_smooth_as_two_low_passes() -> None:
    process = Process(np.eye(8), 0.8)
    motion = acted(process, 20_000, 1)
    for frames in (0, 1, 2, 8):
        alike = (motion[frames:] * motion[: len(motion) - frames]).mean()
        assert alike == pytest.approx(process.likeness(frames), abs=0.02)


def test_what_has_not_moved_moves_as_callers_do() -> None:
    still = np.tile(np.arange(D, dtype=float), (5, 1))
    for vectors in (still, still[:1]):
        slow, quick = expected_motion(vectors)
        variance = np.diag(slow.covariance + quick.covariance)
        assert np.sqrt(variance[:GEOMETRY]) == pytest.approx(USUAL_MOTION / 2)
        assert variance[GEOMETRY:] == pytest.approx(0)


def test_what_was_seen_may_go_on_but_for_what_is_alike_by_chance() -> None:
    vectors = seen()
    slow, quick = expected_motion(vectors)
    added = expected_motion(vectors[:1])
    of_seen = slow.covariance + quick.covariance - added[0].covariance - added[1].covariance
    measured = np.cov(vectors.T)
    assert np.diag(of_seen) == pytest.approx(np.diag(measured))
    # Within pose, and within all else, which is split alike.
    for part in (slice(0, 6), slice(6, None)):
        off = ~np.eye(len(measured[part, part]), dtype=bool)
        assert of_seen[part, part][off] == pytest.approx((1 - CHANCE) * measured[part, part][off])


def test_both_lids_close_together() -> None:
    left, right = (6 + index for index in LIDS)
    for process in expected_motion(np.zeros((1, D))):
        both = process.covariance
        alike = both[left, right] / np.sqrt(both[left, left] * both[right, right])
        assert alike == pytest.approx(LIDS_ALIKE)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_errors_are_those_of_predictions(count: int) -> None:
    frames = np.random.default_rng(2).integers(-999, 999, (count + 1, 5)) * UNIT
    found = prediction_errors(count)
    assert found[0][0] @ frames == pytest.approx(frames[0])
    assert found[1][0] @ frames == pytest.approx(frames[count] - frames[0])
    known, seen_of_kind = {0: frames[0], count: frames[count]}, [0] * KINDS
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
    components = expected_components(vectors, harm(), MODES, count, step)
    assert components.spreads.shape == (D, KINDS)
    slow, quick = expected_motion(vectors)
    motion = acted(slow, 4000, 1) + acted(quick, 4000, 2)
    values = project(components, vectors.mean(0) + motion[::step], harm())
    measured = measure_spreads(values, count).astype(int)
    off = components.spreads.astype(int) - measured
    strong = components.spreads > 24  # where measuring does not matter
    assert strong.sum() > D
    assert np.abs(off[strong]).mean() < 2  # half an octave is 2


def test_nothing_is_left_out_and_the_strongest_are_first() -> None:
    components = expected_components(seen(1), harm(), MODES, 8)
    assert len(components.basis) == D
    assert components.spreads[0, 0] > components.spreads[GEOMETRY - 1, 0]
