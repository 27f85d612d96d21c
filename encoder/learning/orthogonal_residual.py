"""The residual of frames after least-squares projection on modes, by Gram matrices.

Deflation as in orthogonal matching pursuit: the leading direction of the residual is the next mode.
"""

import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array, Single

# Relative ridge on the modes' Gram matrix, which is nearly singular for nearly equal modes.
RIDGE = 1e-9


class OrthogonalResidual:
    """The residual of frames (t, d) outside the span of modes (m, d).

    Only inner products are updated: a new frame or mode costs its inner products with all others.
    """

    def __init__(self, frames: Single) -> None:
        self._frames = list(frames)
        self._modes: list[Single] = []
        self._frame_gram: Array = (frames @ frames.T).astype(np.float64)
        self._projections: Array = np.zeros((len(frames), 0))
        self._mode_gram: Array = np.zeros((0, 0))
        self._solve()

    def __len__(self) -> int:
        """The number of frames."""
        return len(self._frames)

    @property
    def mean_log_energy(self) -> float:
        """Mean over the frames of log2 of the residual energy."""
        return float(np.log2(np.maximum(self.energies, 1e-6)).mean())

    @property
    def energies(self) -> Array:
        """(t,) residual energy of each frame."""
        return np.asarray(np.diag(self._residual_gram))

    def weighted_energy(self, weights: Array | float = 1.0) -> float:
        """Residual energy of all frames, each frame multiplied by its weight (t,)."""
        return float((self.energies * weights**2).sum())

    def leading_direction(self, weights: Array | float = 1.0) -> tuple[Single, float]:
        """The first principal direction (d,) of the residual, and its share of the residual energy.

        The direction has the RMS length of the frames' components along it.
        weights: (t,) factors of the frames.  Raises `ValueError` if there are no frames.
        """
        if not len(self):
            raise ValueError("there are no frames, expected one or more")
        factors_by_frame = np.broadcast_to(weights, len(self))
        values, vectors = np.linalg.eigh(
            self._residual_gram * np.outer(factors_by_frame, factors_by_frame)
        )
        frame_factors = vectors[:, -1] * factors_by_frame / np.sqrt(len(self))
        direction = np.zeros_like(self._frames[0])
        for factors, rows in (
            (frame_factors, self._frames),
            (-frame_factors @ self._coefficients, self._modes),
        ):
            for factor, row in zip(factors, rows, strict=True):
                _add_multiple(direction, np.float32(factor), row)
        return direction, float(values[-1] / max(values.sum(), 1e-9))

    def add_frame(self, frame: Single) -> None:
        """Append a frame (d,)."""
        self._frames.append(frame)
        self._frame_gram = _bordered(self._frame_gram, _inner_products(self._frames, frame))
        self._projections = np.vstack([self._projections, _inner_products(self._modes, frame)])
        self._solve()

    def drop_oldest_frame(self) -> None:
        """Remove the first frame."""
        self._frames.pop(0)
        self._frame_gram, self._projections = self._frame_gram[1:, 1:], self._projections[1:]
        self._solve()

    def drop_newest_frame(self) -> None:
        """Undo the last `add_frame`."""
        self._frames.pop()
        self._frame_gram, self._projections = self._frame_gram[:-1, :-1], self._projections[:-1]
        self._solve()

    def add_mode(self, mode: Single) -> None:
        """Append a mode (d,): its direction leaves the residual.

        Raises `ValueError` if the mode is zero everywhere.
        """
        if not mode.any():
            raise ValueError("a mode is zero everywhere, expected one that explains something")
        self._modes.append(mode)
        self._mode_gram = _bordered(self._mode_gram, _inner_products(self._modes, mode))
        self._projections = np.column_stack(
            [self._projections, _inner_products(self._frames, mode)]
        )
        self._solve()

    def remove_last_mode(self) -> None:
        """Undo the last `add_mode`."""
        self._modes.pop()
        self._mode_gram, self._projections = self._mode_gram[:-1, :-1], self._projections[:, :-1]
        self._solve()

    def _solve(self) -> None:
        """Update the coefficients (t, m) and the Gram matrix (t, t) of the residual."""
        regularised = self._mode_gram * (1 + RIDGE * np.eye(len(self._mode_gram)))
        self._coefficients = np.asarray(
            np.linalg.solve(regularised, self._projections.T).T, np.float64
        )
        self._residual_gram = np.asarray(
            self._frame_gram - self._coefficients @ self._projections.T, np.float64
        )


@jit
def _add_multiple(total: Single, factor: np.float32, row: Single) -> None:
    """Add a multiple of a row (d,) to a total (d,), without an intermediate array."""
    for k in range(len(total)):
        total[k] += factor * row[k]


def _inner_products(rows: list[Single], row: Single) -> Array:
    return np.array([float(each @ row) for each in rows], np.float64)


def _bordered(square: Array, products: Array) -> Array:
    """The symmetric matrix (n, n) extended by one row and column (n + 1,)."""
    n = len(square)
    bordered = np.empty((n + 1, n + 1))
    bordered[:n, :n] = square
    bordered[n], bordered[:, n] = products, products
    return bordered
