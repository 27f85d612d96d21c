"""Search of the quantiser step of an appearance model, several candidates at once."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from math import log2
from typing import Generic, Protocol, TypeVar

from encoder.picture_coding.quantiser_search import STEPS_PER_HALVING
from encoder.runtime.parallel import worker_pool
from protocol.pictures.picture_codec import MAX_STEP_CODE

# Stride of the search, in steps of `picture_codec.step_size`.
SEARCH_STRIDE = 2
# A finer step is tried if the optimum uses less than this share of the bytes.
MIN_FILL = 0.96
# Cost of a mean that exceeds the byte budget, plus its excess in bytes.
INFEASIBLE_COST = 1e3


class Candidate(Protocol):
    """What is coded at one quantiser step.

    cost: is to be least.  size_bytes: of all of it.
    """

    @property
    def step(self) -> int: ...

    @property
    def cost(self) -> float: ...

    @property
    def size_bytes(self) -> int: ...


Coded = TypeVar("Coded", bound=Candidate)


def best_candidate(
    encode: Callable[[int], Coded], start: int, max_bytes: int, workers: int | None = None
) -> Coded:
    """The candidate of least cost: descent in strides from `start`, then one step between.

    That step is one finer if bytes are unused, else the nearest to the vertex of a parabola.
    encode: called with the steps, each once, by several threads.  workers: see `parallel_map`.
    """
    start = min(max(start, SEARCH_STRIDE), MAX_STEP_CODE - SEARCH_STRIDE)
    with worker_pool(workers) as pool:
        trials = _Trials(encode, pool, workers != 1)
        tried = trials.of(start, start - SEARCH_STRIDE)
        best = min(tried, key=_cost)
        stride = SEARCH_STRIDE if best.step == start else -SEARCH_STRIDE
        while 0 <= best.step + stride <= MAX_STEP_CODE:
            trials.foresee(best.step + stride, best.step + 2 * stride)
            tried += trials.of(best.step + stride)
            if tried[-1].cost >= best.cost:
                break
            best = tried[-1]
        excess = {candidate.step - best.step: candidate.cost - best.cost for candidate in tried}
        shift = _parabola_vertex(
            excess.get(-SEARCH_STRIDE, INFEASIBLE_COST), excess.get(SEARCH_STRIDE, INFEASIBLE_COST)
        )
        if best.size_bytes < MIN_FILL * max_bytes:
            shift = -1
        if not shift or best.step + shift < 0:
            return best
        return min(best, *trials.of(best.step + shift), key=_cost)


def filling_candidate(encode: Callable[[int], Coded], start: int, max_bytes: int) -> Coded:
    """The better of two candidates at most: at `start`, and at the step that should use all bytes.

    In half the time of `best_candidate`, which found the same step in four updates of three people.
    """
    start = min(max(start, 0), MAX_STEP_CODE)
    first = encode(start)
    filling = start - round(STEPS_PER_HALVING * log2(max_bytes / max(first.size_bytes, 1)))
    filling = min(max(filling, 0), MAX_STEP_CODE)
    return first if filling == start else min(first, encode(filling), key=_cost)


class _Trials(Generic[Coded]):
    """The candidates of the steps that a search asks for, each encoded once.

    foresees: those that it may ask for next are encoded beside the one that it waits for.
    """

    def __init__(self, encode: Callable[[int], Coded], pool: Executor, foresees: bool) -> None:
        self._encode, self._pool, self._foresees = encode, pool, foresees
        self._begun: dict[int, Future[Coded]] = {}

    def foresee(self, *steps: int) -> None:
        """Begin with steps that may be needed; those beyond the range are left out."""
        for step in steps if self._foresees else ():
            if 0 <= step <= MAX_STEP_CODE:
                self._begin(step)

    def of(self, *steps: int) -> list[Coded]:
        """The candidates of some steps."""
        for step in steps:
            self._begin(step)
        return [self._begun[step].result() for step in steps]

    def _begin(self, step: int) -> None:
        if step not in self._begun:
            self._begun[step] = self._pool.submit(self._encode, step)


def _cost(candidate: Candidate) -> float:
    return candidate.cost


def _parabola_vertex(before: float, after: float) -> int:
    """Steps from the least of three costs, `SEARCH_STRIDE` apart, to the vertex of their parabola.

    before, after: excess of the costs of the finer and the coarser neighbour, >= 0: the vertex lies
        between the neighbours even if one of them is infeasible.
    """
    return round(SEARCH_STRIDE / 2 * (before - after) / max(before + after, 1e-9))
