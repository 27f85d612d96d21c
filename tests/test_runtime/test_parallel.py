"""Thread pools: results do not depend on the number of threads, and no job outlives its pool."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from processes import LIMIT_S
from threadpoolctl import threadpool_info, threadpool_limits  # type: ignore[import-untyped]

from runtime.parallel import (
    SWITCH_INTERVAL_S,
    available_cores,
    beside,
    one_blas_thread,
    parallel_map,
    prefetch,
    worker_pool,
)


@pytest.mark.parametrize("workers", [1, 3, None])
def test_results_keep_their_order(workers: int | None) -> None:
    assert parallel_map(lambda item: item**2, range(20), workers) == [item**2 for item in range(20)]


@pytest.mark.parametrize("workers", [1, 3])
def test_the_first_exception_is_raised(workers: int) -> None:
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda item: 1 / item, [1, 0, 2], workers)


def test_no_job_runs_after_the_block_of_a_worker_pool_has_failed() -> None:
    running, release = threading.Event(), threading.Event()

    def work() -> None:
        running.set()
        release.wait()

    with pytest.raises(RuntimeError), worker_pool() as pool:
        futures = [pool.submit(work) for _ in range(1000)]
        running.wait()
        release.set()
        raise RuntimeError
    assert all(future.done() for future in futures)


def test_work_beside_a_block_ends_with_it() -> None:
    begun, before = threading.Event(), threading.active_count()

    def work(busy: Callable[[], bool]) -> None:
        begun.set()
        while busy():
            time.sleep(0)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), beside(work):
        assert begun.wait(LIMIT_S)
    with pytest.raises(RuntimeError), beside(work):
        raise RuntimeError
    assert threading.active_count() == before


def test_a_worker_pool_shortens_the_switch_interval() -> None:
    before = sys.getswitchinterval()
    with worker_pool() as pool:
        assert pool.submit(sys.getswitchinterval).result() <= before
        assert sys.getswitchinterval() <= SWITCH_INTERVAL_S * 1.01
    assert sys.getswitchinterval() == before


def test_linear_algebra_has_one_thread_within_the_block_alone() -> None:
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == before


def test_one_worker_runs_in_the_calling_thread() -> None:
    assert set(parallel_map(lambda _: threading.get_ident(), range(4), 1)) == {
        threading.get_ident()
    }


def test_the_next_item_is_computed_while_an_item_is_in_use() -> None:
    made = [threading.Event() for _ in range(4)]

    def items() -> Iterator[int]:
        for number, event in enumerate(made):
            event.set()
            yield number

    found = []
    for number in prefetch(items()):
        assert all(event.wait(LIMIT_S) for event in made[: number + 2])
        found.append(number)
    assert found == [0, 1, 2, 3]


def test_an_exception_is_raised_in_place_of_the_item_that_failed() -> None:
    items = prefetch(1 // (2 - number) for number in range(4))
    assert [next(items), next(items)] == [0, 1]
    with pytest.raises(ZeroDivisionError):
        next(items)


def test_closing_waits_for_the_item_under_way() -> None:
    begun, done = threading.Event(), threading.Event()

    def items() -> Iterator[int]:
        yield 0
        begun.set()
        time.sleep(0.05)
        done.set()
        yield 1

    reading = prefetch(items())
    next(reading)
    begun.wait(LIMIT_S)
    reading.close()
    assert done.is_set()


def test_only_cores_that_the_process_may_use_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 5}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert available_cores() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    assert available_cores() == 64
