"""Search of the quantiser step of an appearance model."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from encoder.learning.step_search import (
    INFEASIBLE_COST,
    MAX_TRIALS,
    best_candidate,
    filling_candidate,
)
from protocol.pictures.picture_codec import MAX_STEP_CODE

MAX_BYTES = 1000


@dataclass(frozen=True, slots=True)
class Coded:
    step: int
    cost: float
    wanted_bytes: float
    size_bytes: int = 0


class Coder:
    """Bytes halve every eight steps; cost is least at a step.

    fits: the finest step whose bytes are not too many, by `size_at_fit`.
    """

    def __init__(self, fits: int, least: int, size_at_fit: float = 990.0) -> None:
        self.steps: list[int] = []
        self._fits, self._least, self._size_at_fit = fits, least, size_at_fit

    def __call__(self, step: int) -> Coded:
        self.steps.append(step)
        size = self._size_at_fit * 2 ** ((self._fits - step) / 8)
        return Coded(step, abs(step - self._least), size, round(size))


@pytest.mark.parametrize("least", [13, 14, 15])
@pytest.mark.parametrize("start", [0, 5, 14, 15, 16, 30, MAX_STEP_CODE])
def test_the_least_cost_is_found_from_any_start_and_no_step_is_tried_twice(
    start: int, least: int
) -> None:
    coder = Coder(fits=15, least=least)
    assert best_candidate(coder, start, MAX_BYTES).step == least
    assert len(coder.steps) == len(set(coder.steps))


@pytest.mark.parametrize(
    ("start", "steps"), [(15, [15]), (16, [16, 15]), (30, [30, 15]), (10, [10, 15])]
)
def test_a_short_search_ends_with_the_step_that_should_use_all_bytes(
    start: int, steps: list[int]
) -> None:
    coder = Coder(fits=15, least=15)
    assert filling_candidate(coder, start, MAX_BYTES).step == 15
    assert coder.steps == steps


def test_no_more_steps_are_tried_than_may_be_where_estimates_mislead() -> None:
    def misleading(step: int) -> Coded:
        tried.append(step)
        return Coded(step, -float(step), MAX_BYTES + 1)

    tried: list[int] = []
    best_candidate(misleading, 10, MAX_BYTES)
    assert len(tried) == MAX_TRIALS


@pytest.mark.parametrize("size", [1, 10 * MAX_BYTES])
@pytest.mark.parametrize("start", [-3, 0, MAX_STEP_CODE, MAX_STEP_CODE + 3])
def test_the_search_ends_at_the_limits_of_the_steps(start: int, size: int) -> None:
    def constant(step: int) -> Coded:
        assert 0 <= step <= MAX_STEP_CODE
        return Coded(step, 1.0, size)

    best_candidate(constant, start, MAX_BYTES)


def test_a_candidate_that_is_too_large_is_not_the_best() -> None:
    finer: Callable[[int], Coded] = Coder(fits=18, least=10)

    def encode(step: int) -> Coded:
        coded = finer(step)
        cost = INFEASIBLE_COST if coded.wanted_bytes > MAX_BYTES else coded.cost
        return Coded(step, cost, coded.wanted_bytes)

    assert best_candidate(encode, 16, MAX_BYTES).step == 18
