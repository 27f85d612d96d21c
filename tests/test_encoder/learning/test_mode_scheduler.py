"""When modes are learned in a live call, and from which samples."""

from collections.abc import Sequence
from concurrent.futures import Future
from typing import cast

import numpy as np
import pytest

from encoder.capture.face_crop import Crop
from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import USUAL_LIMITS, LearnedMode
from encoder.learning.mode_scheduler import FramePlace, ModeScheduler

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


class Clock:
    """A clock that stands still unless a test moves it; seconds."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def in_real_time(jobs: Jobs, clock: Clock) -> ModeScheduler:
    """A scheduler of four samples a second."""
    return ModeScheduler(FPS, 0.1, 4.0, jobs.learn, clock, one_by_one=True)


def test_one_mode_after_the_other_without_new_samples_until_there_is_none() -> None:
    jobs = Jobs()
    scheduler = in_real_time(jobs, Clock())
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
    each_s = USUAL_LIMITS.bytes_per_s
    assert jobs.asked[1][1] == pytest.approx(each_s - MODE_BYTES + each_s / FPS)


def test_a_mode_that_takes_the_last_slot_is_followed_by_none() -> None:
    jobs = Jobs()
    scheduler = in_real_time(jobs, Clock())
    scheduler.add_sample(0, SAMPLE)
    scheduler.add_sample(0, SAMPLE)
    scheduler.take_modes(0, 1, may_start=True)
    jobs.futures[0].set_result([MODE])
    assert scheduler.take_modes(1, 1, may_start=True) == [MODE] and len(jobs.asked) == 1


def test_all_at_once_waits_for_the_interval_and_for_samples() -> None:
    jobs = Jobs()
    scheduler = ModeScheduler(FPS, 0.25, 8.0, jobs.learn, Clock())
    scheduler.add_sample(0, SAMPLE)
    # One sample has no direction yet.
    scheduler.take_modes(0, 5, may_start=True)
    assert not jobs.asked
    scheduler.add_sample(0, SAMPLE)
    scheduler.take_modes(0, 5, may_start=True)
    jobs.futures[0].set_result([MODE, MODE])
    assert scheduler.take_modes(1, 5, may_start=True) == [MODE, MODE]
    scheduler.add_sample(4, SAMPLE)
    for index, expected in ((4, 1), (7, 1), (8, 2)):
        scheduler.take_modes(index, 3, may_start=True)
        assert len(jobs.asked) == expected
    assert [modes for _, _, modes in jobs.asked] == [5, 3]


# Of a packet of eight frames that is coded two frames after its last one; landmarks of every second
# frame are known.
PLACES = [FramePlace(to_last, to_last + 2) for to_last in (6, 4, 2, 0)]


@pytest.mark.parametrize(("job_s", "place"), [(0.05, 3), (0.09, 2), (0.15, 1), (0.25, 0)], ids=str)
def test_the_sample_of_a_packet_is_as_late_as_its_mode_is_there_in_time(
    job_s: float, place: int
) -> None:
    jobs, clock = Jobs(), Clock()
    scheduler = in_real_time(jobs, clock)
    added = list[int]()
    for index in range(0, 240, 2):
        if scheduler.wants_sample(index, PLACES[index // 2 % 4]):
            scheduler.add_sample(index, SAMPLE)
            added.append(index // 2 % 4)
        scheduler.take_modes(index, 5, may_start=True)
        if len(jobs.futures) and not jobs.futures[-1].done():
            clock.now_s += job_s
            jobs.futures[-1].set_result([MODE])
    assert added[0] == 0 and set(added[-10:]) == {place}
    assert 28 <= len(added) <= 34


@pytest.mark.parametrize(("done", "follows"), [(8, True), (10, False)], ids=str)
def test_no_mode_follows_that_would_delay_the_next_sample(done: int, follows: bool) -> None:
    jobs = Jobs()
    scheduler = in_real_time(jobs, Clock())
    for index in (0, 6):
        scheduler.add_sample(index, SAMPLE)
    scheduler.take_modes(6, 5, may_start=True)
    jobs.futures[0].set_result([MODE])
    # A mode takes four or five frames; the next sample comes seven or eight after the last.
    assert scheduler.take_modes(done, 5, may_start=True) == [MODE]
    assert len(jobs.asked) == 1 + follows
