"""The Levenberg-Marquardt solver: convergence, damping, and states of infinite cost."""

from collections.abc import Callable

import numpy as np
import pytest

from encoder.fitting.gauss_newton import Damping, Equations, Evaluation, levenberg_marquardt

UNDAMPED_FIRST = Damping(initial=0.0, least_after_increase=0.1, decrease=10.0)
DAMPED = Damping(initial=1e-3, least_after_increase=0.0, decrease=5.0)


def rosenbrock(state: np.ndarray) -> Evaluation:
    """The least-squares form of Rosenbrock's function, minimal at (1, 1)."""
    x, y = state
    residual = np.array([10 * (y - x * x), 1 - x])

    def equations() -> Equations:
        jacobian = np.array([[-20 * x, 10.0], [-1.0, 0.0]])
        return jacobian.T @ jacobian, -jacobian.T @ residual

    return Evaluation(float(residual @ residual), equations)


def add(state: np.ndarray, step: np.ndarray) -> np.ndarray:
    return np.asarray(state + step)


@pytest.mark.parametrize("damping", [UNDAMPED_FIRST, DAMPED])
@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (2.0, -3.0)])
def test_a_curved_valley_is_descended_to_its_minimum(
    damping: Damping, start: tuple[float, float]
) -> None:
    state, evaluation = levenberg_marquardt(rosenbrock, np.array(start), add, damping, 200)
    np.testing.assert_allclose(state, 1, atol=1e-3)
    assert evaluation.cost == rosenbrock(state).cost


def test_a_start_of_infinite_cost_is_returned() -> None:
    def refuse(state: np.ndarray, step: np.ndarray) -> np.ndarray:
        raise AssertionError("a step was taken")

    def nowhere(state: np.ndarray) -> Evaluation:
        return Evaluation(np.inf, lambda: (np.eye(2), np.ones(2)))

    start = np.array([3.0, 4.0])
    state, evaluation = levenberg_marquardt(nowhere, start, refuse, DAMPED, 5)
    assert state is start and evaluation.cost == np.inf


def quadratic(scale: np.ndarray) -> Callable[[np.ndarray], Evaluation]:
    """A quadratic bowl at 1, with its normal matrix multiplied by `scale`: wrong steps."""

    def evaluate(state: np.ndarray) -> Evaluation:
        error = 1 - state
        return Evaluation(float(error @ error), lambda: (np.diag(scale), error))

    return evaluate


def test_steps_that_raise_the_cost_are_damped_until_one_lowers_it() -> None:
    # Undamped steps are five times too long.
    start = np.zeros(2)
    state, evaluation = levenberg_marquardt(
        quadratic(np.full(2, 0.2)), start, add, UNDAMPED_FIRST, 30
    )
    assert evaluation.cost < 0.01
    np.testing.assert_allclose(state, 1, atol=0.1)


def test_linear_parameters_at_the_end_are_not_damped() -> None:
    damping = Damping(initial=9.0, least_after_increase=0.0, decrease=1.0)
    state, _ = levenberg_marquardt(quadratic(np.ones(2)), np.zeros(2), add, damping, 1, undamped=1)
    np.testing.assert_allclose(state, [0.1, 1.0])
