"""The finest quantiser that keeps within a size, found in few trials."""

from collections.abc import Callable

import numpy as np

# A trial that lands where the sizes known so far point is worth several that halve what is left;
# where they mislead, halving goes on.
GUESSES = 4


def finest_within(
    size: Callable[[int], float], most: float, last: int, first: int, steps_per_halving: float
) -> int:
    """The least number in 0..last whose size is at most `most`; `last` if none is.

    size: falls as numbers grow, and halves about every `steps_per_halving`.  first: tried first.
    """
    low, high, middle = 0, last, first
    known: list[tuple[int, float]] = []
    while low < high:
        tried = min(max(middle, low), high - 1)
        found = size(tried)
        known.append((tried, float(np.log2(max(found, 1) / max(most, 1)))))
        low, high = (low, tried) if found <= most else (tried + 1, high)
        middle = (low + high) // 2
        if len(known) <= GUESSES:
            middle = _pointed_at(known, steps_per_halving)
    return low


def _pointed_at(known: list[tuple[int, float]], steps_per_halving: float) -> int:
    """Which number should just fit, by the octaves that known ones are too large."""
    tried, octaves = known[-1]
    if len(known) > 1 and known[-2][1] != octaves:
        before, octaves_before = known[-2]
        steps_per_halving = max((tried - before) / (octaves_before - octaves), 1.0)
    return tried + int(np.ceil(steps_per_halving * octaves))
