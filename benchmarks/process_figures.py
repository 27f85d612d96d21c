"""What other processes have used, from /proc; and the figures of a list."""

import os
import statistics
from collections.abc import Sequence
from pathlib import Path


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_bytes(pid: int) -> int:
    """Resident memory of a process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def median_and_p95(values: Sequence[float]) -> tuple[float, float]:
    """NaN without values."""
    if not values:
        return float("nan"), float("nan")
    return statistics.median(values), sorted(values)[int(0.95 * (len(values) - 1))]
