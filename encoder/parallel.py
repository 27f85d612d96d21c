"""The same work on many frames, on several cores.

NumPy and OpenCV let other threads run, which helps where steps are large.  Many small ones keep
threads waiting for the interpreter: that is work for processes of their own.
"""

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import cv2

Item = TypeVar("Item")
Result = TypeVar("Result")

# A thread that wants the interpreter has it after this time.  Work in NumPy hands it over again and
# again, and to wait the usual 5 ms each time takes as long as the work.
SWITCH_S = 0.0002


def on_cores(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None
) -> list[Result]:
    """`work` of every item, in their order: the same results as one after the other.

    workers: how many at once; None: as many as there are cores for this process.
    The first exception that `work` raises is raised.
    """
    if workers == 1:
        return [work(item) for item in items]
    with switching_often(), ThreadPoolExecutor(workers or usable_cores()) as pool:
        return list(pool.map(work, items))


@contextmanager
def in_processes(work: Callable[..., Result]) -> Iterator[Callable[..., Future[Result]]]:
    """Calls `work` in as many processes as there are cores for this one; ends them with the block.

    Yields what takes the arguments of one call and returns its future.  `work` is copied to each
    process once, with all that it holds; arguments and results are with every call.
    """
    # Not forked: OpenCV's and Zenoh's threads would be missing, perhaps with a lock in their hands.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(usable_cores(), context, _begin, (work,))
    try:
        yield lambda *arguments: pool.submit(_call, *arguments)
    finally:
        pool.shutdown(cancel_futures=True)


# What a process of `in_processes` is for.
_work: Callable[..., Any] | None = None


def _begin(work: Callable[..., Any]) -> None:
    global _work
    # An interrupt is for the process that waits for the results; cores are shared out already.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    _work = work


def _call(*arguments: Any) -> Any:
    assert _work is not None
    return _work(*arguments)


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
