"""Time by stage of processing."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


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

    def mean_cpu_ms(self, frames: int) -> dict[str, float]:
        """Milliseconds of CPU time per frame of each stage, of the calling thread alone."""
        return {name: ns / 1e6 / max(frames, 1) for name, ns in self.cpu_ns.items()}
