"""Search of the finest quantiser whose output keeps within a size, in few trial encodings."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

Encoding = TypeVar("Encoding")

# Trials that are placed by a secant through the sizes known so far; after these the interval is
# halved, which also ends the search where sizes are irregular.
SECANT_STEPS = 4
# A picture's quantiser that is coarser by so many steps takes about half the bytes.
STEPS_PER_HALVING = 8


def finest_quantiser_within(
    encode: Callable[[int], Encoding],
    size_of: Callable[[Encoding], float],
    max_size: float,
    quantisers: range,
    initial: int,
    steps_per_halving: float,
) -> tuple[int, Encoding]:
    """The least quantiser whose encoding has at most `max_size`, or the last one if none has.

    Returns the quantiser and its encoding; no quantiser is tried twice.
    size_of: falls as quantisers grow, and halves about every `steps_per_halving` of them.
    quantisers: consecutive numbers, the finest first.  initial: is tried first if it is one of
    them and not the last.
    Raises `ValueError` if `quantisers` is empty or not consecutive.
    """
    if not quantisers or quantisers.step != 1:
        raise ValueError(f"quantisers is {quantisers}, expected one or more, by steps of 1")
    low, high, middle = quantisers[0], quantisers[-1], initial
    encoded = dict[int, Encoding]()
    trials: list[tuple[int, float]] = []
    while low < high:
        candidate = min(max(middle, low), high - 1)
        encoded[candidate] = encode(candidate)
        size = size_of(encoded[candidate])
        trials.append((candidate, float(np.log2(max(size, 1) / max(max_size, 1)))))
        low, high = (low, candidate) if size <= max_size else (candidate + 1, high)
        middle = (low + high) // 2
        if len(trials) <= SECANT_STEPS:
            middle = _secant_step(trials, steps_per_halving)
    return low, encoded[low] if low in encoded else encode(low)


def _secant_step(trials: list[tuple[int, float]], steps_per_halving: float) -> int:
    """The quantiser that should just fit.

    trials: quantisers, and by how many octaves their encodings are too large.
    """
    last, octaves = trials[-1]
    if len(trials) > 1 and trials[-2][1] != octaves:
        before, octaves_before = trials[-2]
        steps_per_halving = max((last - before) / (octaves_before - octaves), 1.0)
    return last + int(np.ceil(steps_per_halving * octaves))
