"""Time by stage of processing."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageTimer:
    """Adds up the time of named stages.

    Attribute total_ns: time of each stage, ns.
    """

    def __init__(self) -> None:
        self.total_ns: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the `with` block takes to stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            elapsed = time.perf_counter_ns() - start
            self.total_ns[name] = self.total_ns.get(name, 0) + elapsed

    def mean_ms(self, frames: int) -> dict[str, float]:
        """Milliseconds per frame of each stage."""
        return {name: ns / 1e6 / max(frames, 1) for name, ns in self.total_ns.items()}
