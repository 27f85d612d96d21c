"""Ridge regression on principal components or on moments, its ridge chosen on people left out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array, Mask, Single

# Ridges in terms of the mean square of a column of the rows, summed over the rows.
RIDGES = (3.0, 10.0, 30.0, 100.0)
# Components that are regressed on: a ridge leaves hardly anything of further ones.
COMPONENTS = 400
# The same for weighted moments, in terms of the mean square of a column of the rows.
MOMENT_RIDGES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
# Further directions of the search for components, its seed and iterations.
_OVERSAMPLING, _SEED, _ITERATIONS = 20, 5, 2


def fit_ridge(
    rows: Single, targets: Array, half: Mask, ridges: tuple[float, ...] = RIDGES
) -> tuple[Single, Array]:
    """Weights (k, m) with targets ~ rows @ weights, and predictions (N, m) for each half of the
    rows by the other half alone.

    rows: (N, k).  targets: (N, m).  half: (N,) False or True.
    Of the ridges the one is taken that predicts best in this way, each target relative to its
    variance.
    """
    scale = np.maximum(np.sqrt((targets**2).mean(0)), 1e-12)
    wanted = targets / scale
    basis = principal_directions(rows, COMPONENTS)
    scores = (rows @ basis).astype(np.float64)
    unit = float(np.square(rows).sum(dtype=np.float64)) / rows.shape[1]
    parts = [np.flatnonzero(half == value) for value in (False, True)]
    moments = [scores[part].T @ np.hstack([scores[part], wanted[part]]) for part in parts]
    best: tuple[float, float, Array] | None = None
    for ridge in ridges:
        predicted = np.empty_like(wanted)
        for number, part in enumerate(parts):
            share = unit * (1 - len(part) / len(rows))
            predicted[part] = scores[part] @ _solve(moments[1 - number], ridge * share)
        loss = float(((wanted - predicted) ** 2).mean())
        if best is None or loss < best[0]:
            best = loss, ridge, predicted
    assert best is not None
    weights = _solve(moments[0] + moments[1], best[1] * unit) * scale
    return np.asarray(basis @ weights.astype(np.float32), np.float32), best[2] * scale


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Of rows (N, q) and targets (N, m): rows' rows (q, q), rows' targets (q, m)."""

    squares: Array
    products: Array

    @classmethod
    def of(cls, rows: Single, targets: Array) -> "Moments":
        """Of rows (N, q) and targets (N, m)."""
        squares = np.asarray(rows.T @ rows, np.float64)
        return cls(squares, rows.T.astype(np.float64) @ targets)

    def loss(self, weights: Array) -> Array:
        """(m,) squared errors of targets ~ rows @ weights (q, m), less those of no prediction."""
        return np.asarray((weights * (self.squares @ weights - 2 * self.products)).sum(0))

    def ridge(self, ridge: float) -> Array:
        """(q, m) weights.  ridge: in terms of the mean square of a column."""
        unit = np.trace(self.squares) / len(self.squares)
        return np.asarray(
            np.linalg.solve(self.squares + ridge * unit * np.eye(len(self.squares)), self.products)
        )


def weighted_moments(parts: Sequence[Moments], weights: Sequence[float], targets: slice) -> Moments:
    """The moments of all parts, each counted by its weight, of some of the targets."""
    pairs = list(zip(parts, weights, strict=True))
    return Moments(
        np.asarray(sum(weight * each.squares for each, weight in pairs)),
        np.asarray(sum(weight * each.products[:, targets] for each, weight in pairs)),
    )


def ridge_by_halves(
    groups: Sequence[tuple[Moments, Moments]], weights: Sequence[float], targets: slice
) -> Array:
    """(q, m) weights of both halves of each group; each target by the ridge that leaves the least
    of the half that was left out.
    """
    first, second = (
        weighted_moments([group[half] for group in groups], weights, targets) for half in (0, 1)
    )
    both = weighted_moments([first, second], [1.0, 1.0], slice(None))
    best, found = np.full(both.products.shape[1], np.inf), np.zeros(both.products.shape)
    for ridge in MOMENT_RIDGES:
        loss = first.loss(second.ridge(ridge)) + second.loss(first.ridge(ridge))
        better = loss < best
        if better.any():
            found[:, better], best[better] = both.ridge(ridge)[:, better], loss[better]
    return found


def principal_directions(rows: Single, count: int) -> Single:
    """(k, n) about orthonormal directions of the greatest mean square of rows (N, k), n <= `count`,
    by subspace iteration from random directions.
    """
    wanted = min(count + _OVERSAMPLING, *rows.shape)
    random = np.random.default_rng(_SEED).normal(0, 1, (rows.shape[1], wanted))
    directions = _whitened(random.astype(np.float32))
    for _ in range(_ITERATIONS):
        directions = _whitened(rows.T @ (rows @ directions))
    projected = rows @ directions
    _, vectors = np.linalg.eigh((projected.T @ projected).astype(np.float64))
    return np.asarray(directions @ vectors[:, ::-1][:, :count].astype(np.float32))


def _whitened(columns: Single) -> Single:
    """Orthonormal columns that span the same, twice for the sake of single precision."""
    for _ in range(2):
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.float32(1e-12))
        values, vectors = np.linalg.eigh((columns.T @ columns).astype(np.float64))
        kept = values > 1e-6 * values[-1]
        columns = columns @ (vectors[:, kept] / np.sqrt(values[kept])).astype(np.float32)
    return columns


def _solve(moments: Array, added: float) -> Array:
    """Weights by moments (n, n + m) of scores with scores and with targets."""
    count = len(moments)
    system = moments[:, :count] + added * np.eye(count)
    return np.asarray(np.linalg.solve(system, moments[:, count:]))
