"""How long a search takes."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aam.search.search import SearchOptions
from benchmarks.validate_aam.contenders import Contender, found_points, start_pose
from benchmarks.validate_aam.samples import Sample
from runtime.parallel import one_blas_thread

# Searches that load what the first ones need.
UNTIMED = 3


@dataclass(frozen=True, slots=True)
class SearchTime:
    """CPU time of a search with the preparation of its picture, ms: median and 95th percentile."""

    median_ms: float
    p95_ms: float


def search_time(
    contender: Contender, samples: Sequence[Sample], options: SearchOptions
) -> SearchTime:
    """Search each picture from its eyes, one after the other on one core."""
    times = []
    with one_blas_thread():
        for sample in [*samples[:UNTIMED], *samples]:
            pose = start_pose(contender, sample, np.zeros(2), 1.0)
            begin = time.thread_time()
            found_points(contender, sample, pose, options)
            times.append(1000 * (time.thread_time() - begin))
    median_ms, p95_ms = np.percentile(times[UNTIMED:], (50, 95))
    return SearchTime(float(median_ms), float(p95_ms))
