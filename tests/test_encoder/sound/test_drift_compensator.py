"""Sound of a card whose clock is wrong stays where it was heard, without gaps."""

import numpy as np
import pytest

from encoder.sound.drift_compensator import DriftCompensator, resampled
from shared_model.arrays import Samples

RATE_HZ, SIZE = 8000, 160


def call_of(piece: Samples, pieces: int, card: float, jitter: int = 0) -> tuple[Samples, float]:
    """The sound of so many pieces of a card that runs `card` times too fast, and its right length.

    jitter: by how many samples their times are wrong at most.
    """
    compensator, random, put = DriftCompensator(RATE_HZ), np.random.default_rng(1), list[Samples]()
    for number in range(pieces):
        error = random.integers(-jitter, jitter + 1)
        put.append(compensator.put(piece, number * SIZE / card + error))
    sound = np.concatenate(put)
    assert compensator.position == len(sound)
    return sound, pieces * SIZE / card


@pytest.mark.parametrize("card", [1 - 2e-4, 1 + 2e-4, 1 - 3e-3, 1 + 3e-3])
def test_ten_minutes_of_a_wrong_clock_leave_neither_gap_nor_lag(card: float) -> None:
    sound, length = call_of(np.full(SIZE, 1000, np.int16), 30_000, card, jitter=24)
    assert abs(len(sound) - length) < 0.005 * RATE_HZ
    assert np.all(sound == 1000)


def test_sound_of_a_right_clock_stays_as_it_is_whatever_its_times_jitter() -> None:
    piece = np.asarray(np.random.default_rng(2).integers(-9000, 9000, SIZE), np.int16)
    sound, _ = call_of(piece, 1000, 1.0, jitter=24)
    np.testing.assert_array_equal(sound, np.tile(piece, 1000))


def test_sound_that_is_far_away_is_moved_at_once() -> None:
    compensator, piece = DriftCompensator(RATE_HZ), np.full(SIZE, 7, np.int16)
    np.testing.assert_array_equal(compensator.put(piece, 0), piece)
    late = compensator.put(piece, SIZE + 4000)
    assert len(late) == SIZE + 4000 and not late[:4000].any() and (late[4000:] == 7).all()
    assert len(compensator.put(piece, compensator.position - 400)) == 0
    assert len(compensator.fill(compensator.position + 5)) == 5
    assert len(compensator.fill(compensator.position - 5)) == 0


@pytest.mark.parametrize("count", [2, 159, 160, 161, 400])
def test_resampled_sound_keeps_its_shape(count: int) -> None:
    ramp = np.asarray(np.linspace(-3000, 3000, SIZE), np.int16)
    again = resampled(ramp, count)
    np.testing.assert_allclose(again, np.linspace(-3000, 3000, count), atol=2)
