"""When modes are learned in a live call, and from which samples."""

from collections.abc import Sequence
from concurrent.futures import Future
from typing import cast

import numpy as np
import pytest

from encoder.capture.face_crop import Crop
from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import BYTES_PER_S, LearnedMode
from encoder.learning.mode_scheduler import ModeScheduler

FPS, MODE_BYTES = 30.0, 100
MODE = LearnedMode(bytes(MODE_BYTES), np.zeros((1, 1), np.float32))
SAMPLE = FaceSample(cast(Crop, None), np.zeros((468, 3)))


class Jobs:
    """Collects what a scheduler asks for; each job is done when the test says so."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, float, int]] = []
        self.futures: list[Future[list[LearnedMode]]] = []

    def learn(
        self, samples: Sequence[FaceSample], byte_budget: float, max_modes: int
    ) -> "Future[list[LearnedMode]]":
        """Note a job."""
        self.asked.append((len(samples), byte_budget, max_modes))
        self.futures.append(Future())
        return self.futures[-1]


def test_one_mode_after_the_other_without_new_samples_until_there_is_none() -> None:
    jobs = Jobs()
    scheduler = ModeScheduler(FPS, 0.25, 8.0, jobs.learn, one_by_one=True)
    scheduler.add_sample(0, SAMPLE)
    scheduler.add_sample(4, SAMPLE)
    assert scheduler.take_modes(4, 5, may_start=True) == []
    jobs.futures[0].set_result([MODE])
    # The mode can be used now, and the next is under way: no frame is lost between them.
    assert scheduler.take_modes(5, 5, may_start=True) == [MODE]
    jobs.futures[1].set_result([])
    assert scheduler.take_modes(6, 4, may_start=True) == []
    assert scheduler.take_modes(30, 4, may_start=True) == []
    assert [(samples, modes) for samples, _, modes in jobs.asked] == [(2, 1), (0, 1)]
    assert jobs.asked[1][1] == pytest.approx(BYTES_PER_S - MODE_BYTES + BYTES_PER_S / FPS)


def test_a_mode_that_takes_the_last_slot_is_followed_by_none() -> None:
    jobs = Jobs()
    scheduler = ModeScheduler(FPS, 0.25, 8.0, jobs.learn, one_by_one=True)
    scheduler.add_sample(0, SAMPLE)
    scheduler.take_modes(0, 1, may_start=True)
    jobs.futures[0].set_result([MODE])
    assert scheduler.take_modes(1, 1, may_start=True) == [MODE] and len(jobs.asked) == 1


def test_all_at_once_waits_for_the_interval_and_for_samples() -> None:
    jobs = Jobs()
    scheduler = ModeScheduler(FPS, 0.25, 8.0, jobs.learn)
    scheduler.add_sample(0, SAMPLE)
    scheduler.take_modes(0, 5, may_start=True)
    jobs.futures[0].set_result([MODE, MODE])
    assert scheduler.take_modes(1, 5, may_start=True) == [MODE, MODE]
    scheduler.add_sample(4, SAMPLE)
    for index, expected in ((4, 1), (7, 1), (8, 2)):
        scheduler.take_modes(index, 3, may_start=True)
        assert len(jobs.asked) == expected
    assert [modes for _, _, modes in jobs.asked] == [5, 3]
