"""The figures of delays."""

import statistics
from collections.abc import Sequence


def median_and_p95_ms(delays_s: Sequence[float]) -> list[float]:
    """Median and 95th percentile of delays, ms; NaN without any."""
    if not delays_s:
        return [float("nan")] * 2
    p95 = sorted(delays_s)[int(0.95 * (len(delays_s) - 1))]
    return [round(1000 * each, 1) for each in (statistics.median(delays_s), p95)]
