"""How large a wavelet coefficient will be, foretold by a small network from what is around it.

One hidden layer; weights, inputs and outputs are integers and so are all sums, far below 2 ** 53:
floating point is exact and both ends find the same probabilities.  Trained by
`scripts/train_foresight.py`.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from protocol.entropy import WHOLE
from protocol.surroundings import CELLS, Turn, logarithm

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

KINDS, PLANES, LEVELS, ORIENTATIONS, TURNS = 3, 3, 6, 4, 4
STARTS = np.cumsum([0, KINDS, PLANES, LEVELS, ORIENTATIONS, TURNS, CELLS]).tolist()
CLASSES = STARTS[-1] + CELLS
MOST_KNOWN = 1 << 14
# Weights are in 1 / 2 ** _WEIGHT_BITS, hidden values in 1 / 2 ** _HIDDEN_BITS of an octave/16.
WEIGHT_BITS, HIDDEN_BITS, LOGIT_BITS = 13, 4, 8
MOST_HIDDEN = 1 << 14
LOGITS = 10 << LOGIT_BITS
_LEAST = 24
PARTS = ("features", "classes", "last")


@dataclass(frozen=True, slots=True)
class Site:
    """Where a band belongs: kind of picture, plane, level and orientation, indices.

    pictures: how many of the series come before.
    """

    kind: int
    plane: int
    level: int
    orientation: int
    pictures: int = 0


class Network:
    """Probabilities from what is around.

    features: (f + 2, h) weights of features, the last two of the number of pictures before and of
    the grid's height.  classes: (CLASSES, h) what a place belongs to.  last: (h + 1, outputs).
    """

    def __init__(self, features: Array, classes: Array, last: Array) -> None:
        self._features, self._of_all, self._classes = features[:-2], features[-2:], classes
        self._last, self._added = last[:-1], last[-1]
        self._rows, self._columns = classes[STARTS[-2] : STARTS[-1]], classes[STARTS[-1] :]
        self._known: dict[tuple[Site, int, int], Array] = {}

    def zeros(self, features: Array, site: Site, turn: Turn) -> Integers:
        """(n, outputs) the probability of a zero, in 1 / 65536, from features (n, f)."""
        rows, columns = turn.cells
        hidden = features @ self._features
        hidden += self._offset(site, turn.number, turn.grid[0])
        hidden += self._rows.take(rows, 0)
        hidden += self._columns.take(columns, 0)
        hidden *= 2.0 ** (HIDDEN_BITS - WEIGHT_BITS)
        np.floor(hidden, out=hidden)
        np.clip(hidden, 0, MOST_HIDDEN, out=hidden)
        logits = hidden @ self._last
        logits += self._added
        logits *= 2.0**-WEIGHT_BITS
        np.floor(logits, out=logits)
        found = _SQUASHED.take(logits.astype(np.int64) + LOGITS, mode="clip")
        return np.asarray(found, np.int64)

    def _offset(self, site: Site, turn: int, height: int) -> Array:
        """(h,) what is the same for all places of a turn."""
        known = self._known.get((site, turn, height))
        if known is None:
            own = (site.kind, site.plane, site.level, site.orientation, turn)
            rows = [start + index for start, index in zip(STARTS[:-2], own, strict=True)]
            both = np.array([logarithm(site.pictures), logarithm(height)])
            known = self._classes[rows].sum(0) + both @ self._of_all
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[site, turn, height] = known
        return known


def _squashed() -> Integers:
    logits = np.arange(-LOGITS, LOGITS + 1) / 2**LOGIT_BITS
    zeros = np.rint(WHOLE / (1 + np.exp(-logits)))
    return np.asarray(np.clip(zeros, _LEAST, WHOLE - _LEAST), np.int64)


_SQUASHED = _squashed()


@dataclass(frozen=True, slots=True)
class Networks:
    """What foretells the flag of a tile, the size and the sign of a coefficient.

    Outputs of sizes: is it nothing; is a size of 1, of 2, of 3 or 4, of 5 to 8, of more the whole?
    """

    tiles: Network
    sizes: Network
    signs: Network


@lru_cache
def networks() -> Networks:
    """Those that both ends have."""
    with files("protocol").joinpath("data/foresight.npz").open("rb") as file:
        stored = np.load(file)
        return Networks(
            *(
                Network(*(stored[f"{name}_{part}"].astype(np.float64) for part in PARTS))
                for name in Networks.__slots__
            )
        )
