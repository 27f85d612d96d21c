"""Work on several cores: the same results whatever their number."""

import os
import sys
import threading

import pytest

from encoder.parallel import SWITCH_S, on_cores, usable_cores, workers_beside


@pytest.mark.parametrize("workers", [1, 3, None])
def test_results_keep_their_order(workers: int | None) -> None:
    assert on_cores(lambda item: item**2, range(20), workers) == [item**2 for item in range(20)]


@pytest.mark.parametrize("workers", [1, 3])
def test_the_first_exception_is_raised(workers: int) -> None:
    with pytest.raises(ZeroDivisionError):
        on_cores(lambda item: 1 / item, [1, 0, 2], workers)


def test_nothing_goes_on_when_a_block_with_workers_beside_fails() -> None:
    running, release = threading.Event(), threading.Event()

    def work() -> None:
        running.set()
        release.wait()

    with pytest.raises(RuntimeError), workers_beside() as pool:
        futures = [pool.submit(work) for _ in range(1000)]
        running.wait()
        release.set()
        raise RuntimeError
    assert all(future.done() for future in futures)


def test_workers_beside_take_turns_quickly() -> None:
    before = sys.getswitchinterval()
    with workers_beside() as pool:
        assert pool.submit(sys.getswitchinterval).result() <= before
        assert sys.getswitchinterval() <= SWITCH_S * 1.01
    assert sys.getswitchinterval() == before


def test_one_worker_is_the_caller_itself() -> None:
    assert set(on_cores(lambda _: threading.get_ident(), range(4), 1)) == {threading.get_ident()}


def test_only_cores_that_the_process_may_use_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 5}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert usable_cores() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    assert usable_cores() == 64
