"""Search of the quantiser step of an appearance model."""

from dataclasses import dataclass
from threading import Barrier

import pytest
from processes import LIMIT_S

from encoder.learning.step_search import INFEASIBLE_COST, best_candidate, filling_candidate

MAX_BYTES = 1000


@dataclass(frozen=True, slots=True)
class Coded:
    step: int
    cost: float
    size_bytes: int


class Coder:
    """Costs are least at a step; finer ones than `finest` are too large."""

    def __init__(self, least: float, finest: int = 0) -> None:
        self.steps: list[int] = []
        self._least, self._finest = least, finest

    def __call__(self, step: int) -> Coded:
        self.steps.append(step)
        if step < self._finest:
            return Coded(step, INFEASIBLE_COST, MAX_BYTES + 1)
        return Coded(step, abs(step - self._least) ** 1.5, MAX_BYTES)


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("start", [8, 15, 16, 24])
def test_the_least_cost_is_found_from_any_start_by_any_number_of_threads(
    workers: int, start: int
) -> None:
    coder = Coder(15.2)
    assert best_candidate(coder, start, MAX_BYTES, workers).step == 15
    assert len(coder.steps) == len(set(coder.steps))


def test_one_thread_tries_nothing_that_is_not_needed() -> None:
    coder = Coder(15.9)
    best_candidate(coder, 16, MAX_BYTES, workers=1)
    assert coder.steps == [16, 14, 18]


def test_two_threads_encode_the_next_step_and_the_one_after_it_together() -> None:
    coder, both = Coder(12.0), Barrier(2, timeout=LIMIT_S)

    def encode(step: int) -> Coded:
        if step in (12, 10):
            both.wait()
        return coder(step)

    assert best_candidate(encode, 16, MAX_BYTES, workers=2).step == 12


@pytest.mark.parametrize("workers", [1, 2])
def test_a_candidate_that_is_too_large_is_not_the_best(workers: int) -> None:
    assert best_candidate(Coder(10.0, finest=18), 16, MAX_BYTES, workers).step >= 18


@pytest.mark.parametrize(
    ("sizes", "tried", "best"),
    [
        ({16: 500, 8: 990}, [16, 8], 8),
        ({16: 980}, [16], 16),
        ({16: 1400, 20: 990}, [16, 20], 20),
        ({16: 700, 12: 1100}, [16, 12], 16),
    ],
)
def test_a_short_search_goes_to_the_step_that_should_use_all_bytes(
    sizes: dict[int, int], tried: list[int], best: int
) -> None:
    steps: list[int] = []

    def encode(step: int) -> Coded:
        steps.append(step)
        cost = step if sizes[step] <= MAX_BYTES else INFEASIBLE_COST
        return Coded(step, cost, sizes[step])

    assert filling_candidate(encode, 16, MAX_BYTES).step == best
    assert steps == tried
