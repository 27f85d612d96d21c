"""What modes leave of frames, by least squares: where the next mode is found."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Keeps modes that are nearly the same apart.
RIDGE = 1e-9


class Remainder:
    """Frames (t, d) and the modes (m, d) that are to explain them; works on their inner products.

    What one more frame or mode takes is their inner products with all that are there.
    """

    def __init__(self, frames: Single) -> None:
        self._frames = list(frames)
        self._modes: list[Single] = []
        self._gram: Array = (frames @ frames.T).astype(np.float64)
        self._along: Array = np.zeros((len(frames), 0))
        self._inner: Array = np.zeros((0, 0))
        self._solve()

    def __len__(self) -> int:
        """The number of frames."""
        return len(self._frames)

    @property
    def error(self) -> float:
        """Mean log2 of the frames' energy that is left."""
        return float(np.log2(np.maximum(np.diag(self._left), 1e-6)).mean())

    def energy(self, weights: Array | float = 1.0) -> float:
        """What is left of the energy of frames multiplied by weights (t,)."""
        return float((np.diag(self._left) * weights**2).sum())

    def strongest(self, weights: Array | float = 1.0) -> tuple[Single, float]:
        """The strongest direction (d,) left, as long as frames usually go along it; and what share
        of the energy left it holds.

        weights: (t,) what frames are multiplied by.  Raises `ValueError` if there are no frames.
        """
        if not len(self):
            raise ValueError("there are no frames, expected one or more")
        each = np.broadcast_to(weights, len(self))
        values, vectors = np.linalg.eigh(self._left * np.outer(each, each))
        of_frames = vectors[:, -1] * each / np.sqrt(len(self))
        found = np.zeros_like(self._frames[0])
        for factors, rows in (
            (of_frames, self._frames),
            (-of_frames @ self._shares, self._modes),
        ):
            for factor, row in zip(factors, rows, strict=True):
                found += np.float32(factor) * row
        return found, float(values[-1] / max(values.sum(), 1e-9))

    def add(self, frame: Single) -> None:
        """One more frame (d,)."""
        self._frames.append(frame)
        self._gram = _bordered(self._gram, _products(self._frames, frame))
        self._along = np.vstack([self._along, _products(self._modes, frame)])
        self._solve()

    def forget(self) -> None:
        """The first frame counts no more."""
        self._frames.pop(0)
        self._gram, self._along = self._gram[1:, 1:], self._along[1:]
        self._solve()

    def explain(self, mode: Single) -> None:
        """One more mode (d,).  Raises `ValueError` if it is nothing but zeros."""
        if not mode.any():
            raise ValueError("a mode is zero everywhere, expected one that explains something")
        self._modes.append(mode)
        self._inner = _bordered(self._inner, _products(self._modes, mode))
        self._along = np.column_stack([self._along, _products(self._frames, mode)])
        self._solve()

    def withdraw(self) -> None:
        """The last mode explains nothing any more."""
        self._modes.pop()
        self._inner, self._along = self._inner[:-1, :-1], self._along[:, :-1]
        self._solve()

    def _solve(self) -> None:
        """(t, m) what each frame has of each mode; (t, t) inner products of what is left."""
        inner = self._inner * (1 + RIDGE * np.eye(len(self._inner)))
        self._shares = np.asarray(np.linalg.solve(inner, self._along.T).T, np.float64)
        self._left = np.asarray(self._gram - self._shares @ self._along.T, np.float64)


def _products(rows: list[Single], row: Single) -> Array:
    return np.array([float(each @ row) for each in rows], np.float64)


def _bordered(square: Array, products: Array) -> Array:
    """A symmetric matrix (n, n) with one row and column (n + 1,) more."""
    n = len(square)
    found = np.empty((n + 1, n + 1))
    found[:n, :n] = square
    found[n], found[:, n] = products, products
    return found
