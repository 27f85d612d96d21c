"""The solvers of all least-squares fits: Gauss-Newton, plain and damped (Levenberg-Marquardt).

Plain where the problem is nearly linear, so that every step can be taken without evaluating its
cost: landmarks of one frame, coarse pictures.  Damped where pictures are compared in detail, and
where a fit begins far away.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from encoder.fitting.bounded_step import bounded_step
from shared_model.arrays import Array, Mask

Equations = tuple[Array, Array]
# How far each value of a step (n,) may go down, and up.
Room = tuple[Array, Array]
State = TypeVar("State")

# An iteration that changes the cost by no more than this share is the last.
RELATIVE_TOLERANCE = 1e-3
DAMPING_INCREASE = 10.0


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The cost of a state, and what linearises the problem there.

    equations: computes the normal equations of the next step: matrix (n, n), right side (n,).
    """

    cost: float
    equations: Callable[[], Equations]


AnyEvaluation = TypeVar("AnyEvaluation", bound=Evaluation)


@dataclass(frozen=True, slots=True)
class Damping:
    """How steps are damped: shares of the normal matrix's diagonal are added to it (Marquardt).

    initial: share at the first step.  least_after_increase: share after a step that raised the
    cost, at least.  decrease: divisor after a step that lowered it.
    relative_ridge, absolute_ridge: always added, so that a parameter without evidence is solvable.
    """

    initial: float
    least_after_increase: float
    decrease: float
    relative_ridge: float = 0.0
    absolute_ridge: float = 0.0


def solve(normal: Array, right: Array, room: Room | None = None, free: Mask | None = None) -> Array:
    """The step (n,) that solves normal equations within its room; None: there are no bounds.

    free: (n,) what the step may move, where there are bounds; None: all.
    """
    if room is None:
        return np.asarray(np.linalg.solve(normal, right), np.float64)
    return bounded_step(normal, right, np.ones(len(right), bool) if free is None else free, *room)


def gauss_newton(
    equations: Callable[[State], Equations],
    start: State,
    apply_step: Callable[[State, Array], State],
    iterations: int,
    min_decrease: float = -np.inf,
    room: Callable[[State], Room] | None = None,
    free: Mask | None = None,
) -> State:
    """The state after some Gauss-Newton steps.

    equations: the normal equations at a state.
    apply_step: adds a step (n,) to a state.
    iterations: at most, and at least one; a step whose linearised decrease of the sum of squares
        is less than `min_decrease` is the last.
    room: how far each value of a step may go down and up; None: any way.
    free: see `solve`.
    """
    state = start
    for _ in range(iterations):
        normal, right = equations(state)
        step = solve(normal, right, room and room(state), free)
        state = apply_step(state, step)
        if step @ right < min_decrease:
            break
    return state


def levenberg_marquardt(
    evaluate: Callable[[State], AnyEvaluation],
    start: State,
    apply_step: Callable[[State, Array], State],
    damping: Damping,
    iterations: int,
    undamped: int = 0,
    room: Callable[[State], Room] | None = None,
) -> tuple[State, AnyEvaluation]:
    """The state of least cost among those that damped Gauss-Newton steps reach, and its evaluation.

    start: returned as it is if its cost is infinite.
    apply_step: adds a step (n,) to a state.
    iterations: at most; the solver stops earlier at `RELATIVE_TOLERANCE`.
    undamped: number of parameters at the end, linear ones, that are not damped.
    room: see `gauss_newton`.
    """
    best, at = start, evaluate(start)
    if not np.isfinite(at.cost):
        return best, at
    factor = damping.initial
    equations: Equations | None = None
    for _ in range(iterations):
        equations = equations or at.equations()
        step = damped_step(equations, factor, damping, undamped, room and room(best))
        trial = apply_step(best, step)
        tried = evaluate(trial)
        converged = abs(at.cost - tried.cost) < RELATIVE_TOLERANCE * at.cost
        if tried.cost <= at.cost:
            best, at, equations = trial, tried, None
            factor /= damping.decrease
        else:
            factor = max(DAMPING_INCREASE * factor, damping.least_after_increase)
        if converged:
            break
    return best, at


def damped_step(
    equations: Equations,
    factor: float,
    damping: Damping,
    undamped: int,
    room: Room | None = None,
) -> Array:
    """The step (n,) that solves the equations, see `Evaluation`, within its room.

    factor: share of the normal matrix's diagonal that is added to it, but for the last `undamped`
    parameters.
    """
    normal, right = equations
    share = np.full(len(normal), damping.relative_ridge)
    share[: len(normal) - undamped] += factor
    return solve(normal + np.diag(share * np.diag(normal) + damping.absolute_ridge), right, room)
