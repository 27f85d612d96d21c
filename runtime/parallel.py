"""Thread pools: NumPy, OpenCV and compiled loops release the interpreter lock while they work."""

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

Item = TypeVar("Item")
Result = TypeVar("Result")

# A thread that waits for the interpreter gets it after this time.  Code that calls NumPy gives the
# interpreter up often; with the default of 5 ms the waits would take as long as the work.
SWITCH_INTERVAL_S = 0.0002
# By how much the niceness of low-priority threads exceeds that of the process; the niceness of a
# process of low priority among the sessions of its host.  More, and beside other programs of normal
# priority it gets so little that a call has no modes; less, and it holds up the frames.
NICENESS, SESSION_NICENESS = 2, 2


def parallel_map(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int | None
) -> list[Result]:
    """Apply `function` to all items, several at once; the results are in the order of the items.

    workers: number of threads; None: as many as there are cores for this process.
    Raises the first exception that `function` raises.
    """
    if workers == 1:
        return [function(item) for item in items]
    with worker_pool(workers) as pool:
        return list(pool.map(function, items))


def prefetch(items: Iterator[Item]) -> Generator[Item, None, None]:
    """Yield the items; each is computed in the background while the one before it is in use.

    An exception is raised in place of the item that failed.  Closing the generator waits for the
    item under way.
    """
    with worker_pool(1) as worker:
        job = worker.submit(next, items, None)
        while (item := job.result()) is not None:
            job = worker.submit(next, items, None)
            yield item


@contextmanager
def beside(work: Callable[[Callable[[], bool]], None]) -> Iterator[None]:
    """Run `work(busy)` in a thread beside the block; once that is left, `busy()` is false.

    Leaving the block waits for the work, and raises what that has raised, unless the block raises.
    """
    left = threading.Event()
    with ThreadPoolExecutor(1) as executor:
        job = executor.submit(work, lambda: not left.is_set())
        try:
            yield
        finally:
            left.set()
        job.result()


@contextmanager
def worker_pool(workers: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """A thread pool; leaving the block cancels the jobs that have not started.

    workers: see `parallel_map`.
    """
    pool = ThreadPoolExecutor(workers or available_cores())
    try:
        with short_switch_interval():
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let each call of linear algebra take one core within the block.

    Its matrices are small: with threads of its own for each, the Gram matrix of a frame's fit takes
    a hundred times as long.
    """
    with threadpool_limits(1, user_api="blas"):
        yield


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let threads hand the interpreter over after `SWITCH_INTERVAL_S` within the block."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, SWITCH_INTERVAL_S))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def available_cores() -> int:
    """Number of cores this process may run on: a container may have fewer than its host."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def low_priority_executor(workers: int, niceness: int = NICENESS) -> ThreadPoolExecutor:
    """A thread pool whose threads yield to all others, where the system has priorities of threads.

    workers: number of threads.  niceness: how much nicer than the others they are.
    """
    return ThreadPoolExecutor(workers, initializer=_lower_priority, initargs=(niceness,))


def lower_priority_of_process() -> None:
    """Let this process, which is alone in its session, yield to all others.

    Linux may share the cores among sessions (autogroup): niceness then orders no more than the
    threads of each, and a session has a niceness of its own.  With two busy threads of such a
    process a frame of 16 ms takes 8 ms longer if only they are nice, 1 ms if the session is.
    """
    with suppress(OSError):
        os.nice(NICENESS)
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(SESSION_NICENESS), "ascii")


def _lower_priority(niceness: int) -> None:
    if sys.platform == "linux":
        nice = os.getpriority(os.PRIO_PROCESS, 0) + niceness
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)
