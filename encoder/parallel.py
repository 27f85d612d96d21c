"""The same work on many frames, on several cores: NumPy and OpenCV let other threads run."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def on_cores(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None
) -> list[Result]:
    """`work` of every item, in their order: the same results as one after the other.

    workers: how many at once; None: as many as there are cores for this process.
    The first exception that `work` raises is raised.
    """
    if workers == 1:
        return [work(item) for item in items]
    with ThreadPoolExecutor(workers or usable_cores()) as pool:
        return list(pool.map(work, items))


def usable_cores() -> int:
    """The cores that this process may run on: in a container perhaps fewer than the host has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
