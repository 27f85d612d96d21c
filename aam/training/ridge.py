"""Ridge regression whose ridge is chosen on people that were left out."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Ridges in terms of the mean square of a column of the rows, summed over the rows.
RIDGES = (3.0, 10.0, 30.0, 100.0)


def fit_ridge(
    rows: Single, targets: Array, half: NDArray[np.bool_], ridges: tuple[float, ...] = RIDGES
) -> tuple[Single, Array]:
    """Weights (k, m) with targets ~ rows @ weights, and predictions (N, m) for each half of the
    rows by the other half alone.

    rows: (N, k).  targets: (N, m).  half: (N,) False or True.
    Of the ridges the one is taken that predicts best in this way, each target relative to its
    variance.
    """
    scale = np.maximum(np.sqrt((targets**2).mean(0)), 1e-12)
    wanted = targets / scale
    is_wide = rows.shape[1] > len(rows)
    parts = [np.flatnonzero(half == value) for value in (False, True)]
    if is_wide:
        whole = _gram(rows)
        grams = [whole[np.ix_(part, part)] for part in parts]
    else:
        grams = [_gram(rows[part].T) for part in parts]
        whole = grams[0] + grams[1]
    best: tuple[float, float, Array] | None = None
    for ridge in ridges:
        predicted = np.empty_like(wanted)
        for number, part in enumerate(parts):
            other = parts[1 - number]
            weights = _solve(rows[other], wanted[other], grams[1 - number], ridge)
            predicted[part] = rows[part] @ weights
        loss = float(((wanted - predicted) ** 2).mean())
        if best is None or loss < best[0]:
            best = loss, ridge, predicted
    assert best is not None
    weights = _solve(rows, wanted, whole, best[1])
    return np.asarray(weights * scale, np.float32), best[2] * scale


def _gram(rows: Single) -> Array:
    return (rows @ rows.T).astype(np.float64)


def _solve(rows: Single, targets: Array, gram: Array, ridge: float) -> Single:
    """gram: of the rows if they are fewer than their columns, else of the columns."""
    added = ridge * np.trace(gram) / rows.shape[1]
    system = gram + added * np.eye(len(gram))
    if len(gram) == rows.shape[1]:
        moments = (rows.T @ targets.astype(np.float32)).astype(np.float64)
        return np.asarray(np.linalg.solve(system, moments), np.float32)
    solution = np.linalg.solve(system, targets)
    return np.asarray(rows.T @ solution.astype(np.float32))
