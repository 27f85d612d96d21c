"""How large a wavelet coefficient will be, foretold by a small network from what is around it.

One hidden layer; weights and inputs are integers and so are all sums, far below 2 ** 53: floating
point is exact and both ends find the same probabilities.  The tables of logarithms and of logits
come out of `log2` and `exp`, none of whose values lies within 3e-4 of where it would round to
another integer.  The weights are part of the format: others need other version numbers.  Trained
by `scripts/train_foresight.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import WHOLE
from protocol.pictures.coefficient_context import CELLS, TURNS, Turn, logarithm
from protocol.pictures.wavelet import LEVELS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Band = TypeVar("Band")

# Kinds of pictures, and the orientation of the coarsest subband, which comes after the details'.
STILL, TEXTURE, MODE = range(3)
COARSE = 3
# How many kinds, planes, levels with the coarsest, orientations and turns there are, and where the
# weights of each start; those of places by rows and by columns come last.
_COUNTS = (3, 3, 1 + LEVELS, 1 + COARSE, len(TURNS), CELLS)
STARTS = np.cumsum([0, *_COUNTS]).tolist()
CLASSES = STARTS[-1] + CELLS
# A hidden value is in 1 / 2 ** HIDDEN_BITS of an octave of size, a logit in 1 / 2 ** LOGIT_BITS;
# weights that make either have WEIGHT_BITS more.
WEIGHT_BITS, HIDDEN_BITS, LOGIT_BITS = 13, 4, 8
# Bounds the sums, whatever the weights.
MOST_HIDDEN = 1 << 14
# Nothing is surer than the least probability, in 1 / 65536, which logits beyond these have.
LOGITS = 8 << LOGIT_BITS
LEAST = 24
PARTS = ("features", "classes", "last")


@dataclass(frozen=True, slots=True)
class Site:
    """Where a band belongs.

    kind: `STILL`, `TEXTURE` or `MODE`.  plane: luma, then two colours.  level: 0 is the coarsest
    subband, 1 the coarsest details.  orientation: of details 0..2, or `COARSE`.
    pictures: how many of the series come before.
    """

    kind: int
    plane: int
    level: int
    orientation: int
    pictures: int = 0

    def of(self, coarse: Band, details: Sequence[Sequence[Band]]) -> Band:
        """The band of this level and orientation: a plane's coarsest, or one of its details."""
        return details[self.level - 1][self.orientation] if self.level else coarse

    def classes(self, turn: Turn) -> list[int]:
        """Rows of a network's weights that hold for all places of a turn."""
        own = (self.kind, self.plane, self.level, self.orientation, turn.number)
        return [start + index for start, index in zip(STARTS[: len(own)], own, strict=True)]

    def features(self, turn: Turn) -> list[float]:
        """What is known of all places of a turn, beside what is around them."""
        return [logarithm(self.pictures), logarithm(turn.grid[0])]


class Network:
    """Probabilities from what is around.

    features: (f + 2, h) weights of features, the last two of `Site.features`.
    classes: (CLASSES, h) weights of what a place belongs to.  last: (h + 1, outputs).
    Attributes: features (f, h) of what is around a place, of_all (2, h) of a whole turn, classes as
    above, rows and columns (CELLS, h) those of where a place is, last (h, outputs) of the hidden
    values, added (outputs,) to their sum.
    """

    def __init__(self, features: Array, classes: Array, last: Array) -> None:
        self.features, self.of_all, self.classes = features[:-2], features[-2:], classes
        self.last, self.added = last[:-1], last[-1]
        self.rows, self.columns = classes[STARTS[-2] : STARTS[-1]], classes[STARTS[-1] :]

    def common(self, site: Site, turn: Turn) -> Array:
        """(h,) what all places of a turn add to the hidden values."""
        own = self.classes[site.classes(turn)].sum(0)
        return np.asarray(own + np.array(site.features(turn)) @ self.of_all)

    def zeros(self, features: Array, site: Site, turn: Turn) -> Integers:
        """(n, outputs) the probability of a zero, in 1 / 65536, from features (n, f)."""
        rows, columns = turn.cells
        hidden = features @ self.features
        hidden += self.common(site, turn)
        hidden += self.rows.take(rows, 0)
        hidden += self.columns.take(columns, 0)
        hidden *= 2.0 ** (HIDDEN_BITS - WEIGHT_BITS)
        np.floor(hidden, out=hidden)
        np.clip(hidden, 0, MOST_HIDDEN, out=hidden)
        logits = hidden @ self.last
        logits += self.added
        logits *= 2.0**-WEIGHT_BITS
        np.floor(logits, out=logits)
        found = SQUASHED.take(logits.astype(np.int64) + LOGITS, mode="clip")
        return np.asarray(found, np.int64)


def _squashed() -> Integers:
    logits = np.arange(-LOGITS, LOGITS + 1) / 2**LOGIT_BITS
    zeros = np.rint(WHOLE / (1 + np.exp(-logits)))
    return np.asarray(np.clip(zeros, LEAST, WHOLE - LEAST), np.int64)


SQUASHED = _squashed()


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
