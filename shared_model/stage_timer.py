"""Time by stage of processing, and of single frames."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class StageTimes:
    """Mean times of stages.

    stage_ms: time per frame of each stage, ms; stage_cpu_ms: CPU time of the thread that waits for
        it.
    """

    stage_ms: dict[str, float]
    stage_cpu_ms: dict[str, float]


class StageTimer:
    """Adds up the time of named stages.

    Attributes total_ns: time of each stage, ns; cpu_ns: CPU time of the calling thread in it, ns.
    """

    def __init__(self) -> None:
        self.total_ns: dict[str, int] = {}
        self.cpu_ns: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the `with` block takes to stage `name`."""
        start, cpu_start = time.perf_counter_ns(), time.thread_time_ns()
        try:
            yield
        finally:
            elapsed, cpu = time.perf_counter_ns() - start, time.thread_time_ns() - cpu_start
            self.total_ns[name] = self.total_ns.get(name, 0) + elapsed
            self.cpu_ns[name] = self.cpu_ns.get(name, 0) + cpu

    def mean_ms(self, frames: int) -> dict[str, float]:
        """Milliseconds per frame of each stage."""
        return {name: ns / 1e6 / max(frames, 1) for name, ns in self.total_ns.items()}

    def times(self, frames: int) -> StageTimes:
        """The mean times of so many frames."""
        cpu_ms = {name: ns / 1e6 / max(frames, 1) for name, ns in self.cpu_ns.items()}
        return StageTimes(self.mean_ms(frames), cpu_ms)

    def whole_ns(self, but_for: str) -> int:
        """Time of all stages but one, ns."""
        return sum(ns for name, ns in self.total_ns.items() if name != but_for)


def frame_times(times_ms: Sequence[float]) -> dict[str, float]:
    """Median, 95th percentile and maximum of the times of frames, ms; empty if there is none."""
    if not times_ms:
        return {}
    median, most = np.percentile(times_ms, [50, 95])
    return {"median": float(median), "p95": float(most), "worst": float(max(times_ms))}
