"""A least-squares step within bounds."""

import numpy as np

from encoder.fitting.bounded_step import bounded_step


def test_the_other_values_take_over_what_a_bound_keeps_one_from() -> None:
    rows = np.array([[1.0, 0.9], [0.0, 0.5], [1.0, 0.0]])
    target = np.array([2.0, 0.1, 2.5])
    low, high = np.array([-1.0, -1.0]), np.array([0.5, 2.0])
    normal, gradient = rows.T @ rows, rows.T @ target
    found = bounded_step(normal, gradient, np.ones(2, bool), low, high)
    # At the first bound the other's equation holds alone, and the first would go on if it could.
    expected = np.array([0.5, (gradient[1] - normal[1, 0] * 0.5) / normal[1, 1]])
    assert (gradient - normal @ expected)[0] > 0
    np.testing.assert_allclose(found, expected)
    clipped = np.clip(np.linalg.solve(normal, gradient), low, high)
    assert np.abs(clipped - expected).max() > 0.1


def test_what_is_not_free_stays_and_bounds_that_are_far_change_nothing() -> None:
    random = np.random.default_rng(1)
    rows = random.normal(size=(9, 4))
    normal, gradient = rows.T @ rows, rows.T @ random.normal(size=9)
    free, far = np.array([True, False, True, True]), np.full(4, np.inf)
    found = bounded_step(normal, gradient, free, -far, far)
    assert found[1] == 0
    expected = np.linalg.solve(normal[np.ix_(free, free)], gradient[free])
    np.testing.assert_allclose(found[free], expected)


def test_a_matrix_that_is_not_positive_definite_is_solved_without_bounds_and_clipped() -> None:
    normal = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 5.0]])
    gradient, free = np.array([3.0, 9.0, 1.0]), np.array([True, True, False])
    found = bounded_step(normal, gradient, free, np.full(3, -1.0), np.full(3, 2.0))
    np.testing.assert_allclose(np.linalg.solve(normal[:2, :2], gradient[:2]), [5.0, -1.0])
    np.testing.assert_allclose(found, [2.0, -1.0, 0.0])
