"""The same work on many frames, on several cores: NumPy and OpenCV let other threads run."""

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

# A thread that wants the interpreter has it after this time.  Work in NumPy hands it over again and
# again, and to wait the usual 5 ms each time takes as long as the work.
SWITCH_S = 0.0002


# How much the frames go before, as the system counts niceness.
NICE = 5


def on_cores(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None
) -> list[Result]:
    """`work` of every item, in their order: the same results as one after the other.

    workers: how many at once; None: as many as there are cores for this process.
    The first exception that `work` raises is raised.
    """
    if workers == 1:
        return [work(item) for item in items]
    with workers_beside(workers) as pool:
        return list(pool.map(work, items))


def read_ahead(items: Iterator[Item]) -> Generator[Item, None, None]:
    """The same items, each made beside what is done with the one before it.

    Closed, or at its end, it has none in the making.  An exception comes in the item's place.
    """
    with workers_beside(1) as worker:
        job = worker.submit(next, items, None)
        while (item := job.result()) is not None:
            job = worker.submit(next, items, None)
            yield item


@contextmanager
def workers_beside(workers: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Workers beside what the block does; what they have not begun when it is left they never do.

    workers: see `on_cores`.
    """
    pool = ThreadPoolExecutor(workers or usable_cores())
    try:
        with switching_often():
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def switching_often() -> Iterator[None]:
    """Let threads take turns quickly for a while."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, SWITCH_S))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def usable_cores() -> int:
    """The cores that this process may run on: in a container perhaps fewer than the host has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads_beside(count: int) -> ThreadPoolExecutor:
    """Threads that let others go first, where the system tells threads apart."""
    return ThreadPoolExecutor(count, initializer=_step_back)


def _step_back() -> None:
    if sys.platform == "linux":
        nice = os.getpriority(os.PRIO_PROCESS, 0) + NICE
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)
