"""Principal component analysis with a retained share of the variance (thesis eq. 2.21)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Array

# Modes of less variance than this share of the first one's are noise of the arithmetic.
LEAST_SHARE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """x = mean + coefficients @ modes (eq. 2.17).

    mean: (n,).  modes: (m, n) orthonormal rows, the greatest variance first.
    variances: (m,) of the coefficients.  total: variance of the training set, all modes.
    analysis: (n, m) gives the coefficients of x - mean; None: the modes, transposed.
    """

    mean: Array
    modes: Array
    variances: Array
    total: float
    analysis: Array | None = None

    def coefficients(self, values: NDArray[np.floating]) -> Array:
        """(..., m) of values (..., n) (eq. 2.6)."""
        analysis = self.modes.T if self.analysis is None else self.analysis
        return np.asarray((values - self.mean) @ analysis)

    def values(self, coefficients: Array) -> Array:
        """(..., n) of coefficients (..., m) (eq. 2.7)."""
        return np.asarray(self.mean + coefficients @ self.modes)


def principal_components(rows: Array, retained: float, centred: bool = True) -> LinearModel:
    """The least number of components that hold the share `retained`, 0..1, of the variance.

    rows: (N, n), N >= 2.  centred: about the mean of the rows, else about 0.
    The sign of a mode is such that its largest value is positive.
    """
    if rows.ndim != 2 or len(rows) < 2:
        raise ValueError(f"rows has shape {rows.shape}, expected (N >= 2, n)")
    if not 0 < retained <= 1:
        raise ValueError(f"retained is {retained}, expected 0 to 1")
    mean = rows.mean(0) if centred else np.zeros(rows.shape[1])
    offsets = rows - mean
    scale = 1 / (len(rows) - 1)
    if len(rows) < rows.shape[1]:
        # The Gram matrix of the samples is smaller than the covariance.
        values, vectors = np.linalg.eigh(offsets @ offsets.T * scale)
        modes = vectors.T @ offsets
    else:
        values, vectors = np.linalg.eigh(offsets.T @ offsets * scale)
        modes = vectors.T
    order = np.argsort(-values, kind="stable")
    values, modes = np.maximum(values[order], 0), modes[order]
    total = float(values.sum())
    useful = int((values > LEAST_SHARE * max(float(values[0]), 1e-300)).sum())
    enough = int(np.searchsorted(np.cumsum(values), retained * total * (1 - 1e-12))) + 1
    count = max(min(enough, useful), 1)
    modes = modes[:count] / np.maximum(np.linalg.norm(modes[:count], axis=1, keepdims=True), 1e-300)
    largest = modes[np.arange(count), np.abs(modes).argmax(1)]
    return LinearModel(mean, modes * np.sign(largest)[:, None], values[:count], total)


def components_under_metric(rows: Array, retained: float, metric: Array) -> LinearModel:
    """Principal components where the square of a difference d (n,) is d' metric d.

    rows: (N, n).  metric: (n, n) symmetric, positive semi-definite.
    Modes are orthonormal under the metric: what it does not see has no share in the variance.
    """
    values, vectors = np.linalg.eigh(metric)
    length = np.sqrt(np.maximum(values, LEAST_SHARE * values[-1]))
    found = principal_components(rows @ (vectors * length), retained)
    modes = found.modes @ (vectors / length).T
    analysis = (vectors * length) @ found.modes.T
    return LinearModel(rows.mean(0), modes, found.variances, found.total, analysis)


def without_first(model: LinearModel, start: int) -> LinearModel:
    """The model without its first `start` modes."""
    kept = slice(start, None)
    return LinearModel(model.mean, model.modes[kept], model.variances[kept], model.total)
