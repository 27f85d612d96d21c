"""The step of a least-squares fit within bounds, by an active set.

A step that is clipped only after it was solved leaves what the clipped value would have explained
to nobody; here the other values take it over.
"""

import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array, Mask

# Of rounding, beyond a bound.
TOLERANCE = 1e-12


def bounded_step(normal: Array, gradient: Array, free: Mask, low: Array, high: Array) -> Array:
    """(n,) x of normal (n, n) x = gradient (n,) where low <= x <= high, each (n,); zero where it is
    not free.  What exceeds a bound stays at it, and the rest is solved again.

    Where rounding has left `normal` not positive definite, or values are not finite, the step is
    the one without bounds, clipped.  Raises `numpy.linalg.LinAlgError` if that cannot be solved.
    """
    solution, is_solved = _bounded_step(normal, gradient, free, low, high)
    if not is_solved:
        solution = np.zeros(len(gradient))
        unbounded = np.linalg.solve(normal[np.ix_(free, free)], gradient[free])
        solution[free] = np.clip(unbounded, low[free], high[free])
    return solution


@jit
def _bounded_step(
    normal: Array, gradient: Array, free: Mask, low: Array, high: Array
) -> tuple[Array, bool]:
    """See `bounded_step`; and whether all equations could be solved."""
    size = len(gradient)
    free, solution, right = free.copy(), np.zeros(size), np.empty(size)
    factor, chosen = np.empty((size, size)), np.empty(size, np.intp)
    while True:
        count = 0
        for k in range(size):
            if free[k]:
                chosen[count] = k
                count += 1
        if not count:
            return solution, True
        for i in range(count):
            right[i] = gradient[chosen[i]]
            for k in range(size):
                if not free[k]:
                    right[i] -= normal[chosen[i], k] * solution[k]
            for j in range(i + 1):
                factor[i, j] = normal[chosen[i], chosen[j]]
        if not _solve_in_place(factor, right, count):
            return solution, False
        is_within = True
        for i in range(count):
            k = chosen[i]
            solution[k] = right[i]
            if right[i] < low[k] - TOLERANCE or right[i] > high[k] + TOLERANCE:
                solution[k] = min(max(right[i], low[k]), high[k])
                free[k] = is_within = False
        if is_within:
            return solution, True


@jit
def _solve_in_place(factor: Array, right: Array, count: int) -> bool:
    """Solve the first `count` of the equations of a symmetric matrix, whose lower part `factor`
    has, by Cholesky's method; `right` becomes the solution.  Whether it is positive definite.
    """
    for i in range(count):
        for j in range(i + 1):
            total = factor[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            elif total > 0:
                factor[i, i] = np.sqrt(total)
            else:
                return False
    for i in range(count):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]
    return True
