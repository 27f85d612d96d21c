"""The finest quantiser that keeps within a size, found in few trials."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")

# A trial that lands where the sizes known so far point is worth several that halve what is left;
# where they mislead, halving goes on.
GUESSES = 4


def finest_within(
    make: Callable[[int], Item],
    size: Callable[[Item], float],
    most: float,
    numbers: range,
    first: int,
    steps_per_halving: float,
) -> tuple[int, Item]:
    """The least of consecutive `numbers` whose item's size is at most `most`, the last if none is.

    Returns the number and its item; each is made once.
    size: falls as numbers grow, and halves about every `steps_per_halving`.
    first: tried first, unless it is the last.
    Raises `ValueError` if `numbers` is empty or not consecutive.
    """
    if not numbers or numbers.step != 1:
        raise ValueError(f"numbers is {numbers}, expected one or more, by steps of 1")
    low, high, middle = numbers[0], numbers[-1], first
    made = dict[int, Item]()
    known: list[tuple[int, float]] = []
    while low < high:
        tried = min(max(middle, low), high - 1)
        made[tried] = make(tried)
        found = size(made[tried])
        known.append((tried, float(np.log2(max(found, 1) / max(most, 1)))))
        low, high = (low, tried) if found <= most else (tried + 1, high)
        middle = (low + high) // 2
        if len(known) <= GUESSES:
            middle = _pointed_at(known, steps_per_halving)
    return low, made[low] if low in made else make(low)


def _pointed_at(known: list[tuple[int, float]], steps_per_halving: float) -> int:
    """Which number should just fit, by the octaves that known ones are too large."""
    tried, octaves = known[-1]
    if len(known) > 1 and known[-2][1] != octaves:
        before, octaves_before = known[-2]
        steps_per_halving = max((tried - before) / (octaves_before - octaves), 1.0)
    return tried + int(np.ceil(steps_per_halving * octaves))
