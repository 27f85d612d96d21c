"""Search of the quantiser step of an appearance model.

At the best step all modes fit into the bytes and hardly any are left over.  A finer one leaves out
modes, which costs more than coarse ones do.
"""

from collections.abc import Callable, Mapping
from math import ceil, log2
from typing import Protocol, TypeVar

from encoder.picture_coding.quantiser_search import STEPS_PER_HALVING
from protocol.pictures.picture_codec import MAX_STEP_CODE

# Steps that are tried at most on the way to one that just fits.
MAX_TRIALS = 6
# Bytes are used if they are at least this share.
MIN_FILL = 0.96
# Cost of a mean that exceeds the byte budget, plus its excess in bytes.
INFEASIBLE_COST = 1e3


class Candidate(Protocol):
    """What is coded at one quantiser step.

    cost: is to be least.  size_bytes: of all of it.
    wanted_bytes: an estimate of what all modes would take at that step.
    """

    @property
    def step(self) -> int: ...

    @property
    def cost(self) -> float: ...

    @property
    def size_bytes(self) -> int: ...

    @property
    def wanted_bytes(self) -> float: ...


Coded = TypeVar("Coded", bound=Candidate)


def best_candidate(encode: Callable[[int], Coded], start: int, max_bytes: int) -> Coded:
    """The candidate of least cost: from `start` to the step that just fits, then finer ones.

    Those follow while they pay: the last modes matter little.
    encode: called with the steps, each once.
    """
    step = min(max(start, 0), MAX_STEP_CODE)
    tried = dict[int, Coded]()
    too_fine, fits = -1, MAX_STEP_CODE + 1
    while too_fine < step < fits and len(tried) < MAX_TRIALS:
        candidate = tried[step] = encode(step)
        octaves = log2(max(candidate.wanted_bytes, 1) / max(max_bytes, 1))
        too_fine, fits = (step, fits) if octaves > 0 else (too_fine, step)
        if log2(MIN_FILL) <= octaves <= 0:
            break
        # A candidate that runs out of bytes tells little of how much coarser the right one is.
        stride = ceil(STEPS_PER_HALVING * octaves) if octaves <= 0 or len(tried) == 1 else 1
        step = min(max(step + stride, too_fine + 1), fits - 1)
    best = _least(tried)
    while best.step and best.step - 1 not in tried:
        tried[best.step - 1] = encode(best.step - 1)
        best = _least(tried)
    return best


def filling_candidate(encode: Callable[[int], Coded], start: int, max_bytes: int) -> Coded:
    """The better of two candidates at most: at `start`, and at the step that should use all bytes.

    For a model that gets further modes later, which make up for what it lacks: live calls of
    carphone and turn are as good as by `best_candidate`, that of foreman .5 dB better.
    """
    start = min(max(start, 0), MAX_STEP_CODE)
    first = encode(start)
    filling = start - round(STEPS_PER_HALVING * log2(max_bytes / max(first.size_bytes, 1)))
    filling = min(max(filling, 0), MAX_STEP_CODE)
    return first if filling == start else min(first, encode(filling), key=_cost)


def _least(tried: Mapping[int, Coded]) -> Coded:
    return min(tried.values(), key=_cost)


def _cost(candidate: Candidate) -> float:
    return candidate.cost
