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

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.pictures.coefficient_context import (
    PASS_OFFSETS,
    POSITION_CELLS,
    CodingPass,
    log_feature,
)
from protocol.pictures.wavelet import LEVELS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Band = TypeVar("Band")

# Kinds of pictures, and the orientation of the coarsest subband, which comes after the details'.
BACKGROUND, TEXTURE, MODE = range(3)
LOWPASS = 3
# How many kinds, planes, levels with the coarsest, orientations and turns there are, and where the
# weights of each start; those of places by rows and by columns come last.
_COUNTS = (3, 3, 1 + LEVELS, 1 + LOWPASS, len(PASS_OFFSETS), POSITION_CELLS)
CLASS_STARTS = np.cumsum([0, *_COUNTS]).tolist()
CLASS_COUNT = CLASS_STARTS[-1] + POSITION_CELLS
# A hidden value is in 1 / 2 ** HIDDEN_BITS of an octave of size, a logit in 1 / 2 ** LOGIT_BITS;
# weights that make either have WEIGHT_BITS more.
WEIGHT_BITS, HIDDEN_BITS, LOGIT_BITS = 13, 4, 8
# Bounds the sums, whatever the weights.
MAX_HIDDEN = 1 << 14
# Nothing is surer than the least probability, in 1 / 65536, which logits beyond these have.
MAX_LOGIT = 8 << LOGIT_BITS
MIN_PROBABILITY = 24
WEIGHT_ARRAYS = ("features", "classes", "last")


@dataclass(frozen=True, slots=True)
class BandPosition:
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

    def select(self, coarse: Band, details: Sequence[Sequence[Band]]) -> Band:
        """The band of this level and orientation: a plane's coarsest, or one of its details."""
        return details[self.level - 1][self.orientation] if self.level else coarse

    def class_rows(self, turn: CodingPass) -> list[int]:
        """Rows of a network's weights that hold for all places of a turn."""
        own = (self.kind, self.plane, self.level, self.orientation, turn.number)
        return [start + index for start, index in zip(CLASS_STARTS[: len(own)], own, strict=True)]

    def pass_features(self, turn: CodingPass) -> list[float]:
        """What is known of all places of a turn, beside what is around them."""
        return [log_feature(self.pictures), log_feature(turn.grid[0])]


class Mlp:
    """Probabilities from what is around.

    features: (f + 2, h) weights of features, the last two of `Site.features`.
    classes: (CLASSES, h) weights of what a place belongs to.  last: (h + 1, outputs).
    Attributes: features (f, h) of what is around a place, of_all (2, h) of a whole turn, classes as
    above, rows and columns (CELLS, h) those of where a place is, last (h, outputs) of the hidden
    values, added (outputs,) to their sum.
    """

    def __init__(self, features: Array, classes: Array, last: Array) -> None:
        self.feature_weights, self.pass_weights, self.class_weights = (
            features[:-2],
            features[-2:],
            classes,
        )
        self.output_weights, self.output_bias = last[:-1], last[-1]
        self.row_weights, self.column_weights = (
            classes[CLASS_STARTS[-2] : CLASS_STARTS[-1]],
            classes[CLASS_STARTS[-1] :],
        )

    def pass_activation(self, site: BandPosition, turn: CodingPass) -> Array:
        """(h,) what all places of a turn add to the hidden values."""
        own = self.class_weights[site.class_rows(turn)].sum(0)
        return np.asarray(own + np.array(site.pass_features(turn)) @ self.pass_weights)

    def zero_probabilities(self, features: Array, site: BandPosition, turn: CodingPass) -> Integers:
        """(n, outputs) the probability of a zero, in 1 / 65536, from features (n, f)."""
        rows, columns = turn.position_cells
        hidden = features @ self.feature_weights
        hidden += self.pass_activation(site, turn)
        hidden += self.row_weights.take(rows, 0)
        hidden += self.column_weights.take(columns, 0)
        hidden *= 2.0 ** (HIDDEN_BITS - WEIGHT_BITS)
        np.floor(hidden, out=hidden)
        np.clip(hidden, 0, MAX_HIDDEN, out=hidden)
        logits = hidden @ self.output_weights
        logits += self.output_bias
        logits *= 2.0**-WEIGHT_BITS
        np.floor(logits, out=logits)
        found = SIGMOID.take(logits.astype(np.int64) + MAX_LOGIT, mode="clip")
        return np.asarray(found, np.int64)


def _sigmoid_table() -> Integers:
    logits = np.arange(-MAX_LOGIT, MAX_LOGIT + 1) / 2**LOGIT_BITS
    zeros = np.rint(PROBABILITY_ONE / (1 + np.exp(-logits)))
    return np.asarray(np.clip(zeros, MIN_PROBABILITY, PROBABILITY_ONE - MIN_PROBABILITY), np.int64)


SIGMOID = _sigmoid_table()


@dataclass(frozen=True, slots=True)
class ProbabilityModels:
    """What foretells the flag of a tile, the size and the sign of a coefficient.

    Outputs of sizes: is it nothing; is a size of 1, of 2, of 3 or 4, of 5 to 8, of more the whole?
    """

    tiles: Mlp
    sizes: Mlp
    signs: Mlp


@lru_cache
def probability_models() -> ProbabilityModels:
    """Those that both ends have."""
    with files("protocol").joinpath("data/foresight.npz").open("rb") as file:
        stored = np.load(file)
        return ProbabilityModels(
            *(
                Mlp(*(stored[f"{name}_{part}"].astype(np.float64) for part in WEIGHT_ARRAYS))
                for name in ProbabilityModels.__slots__
            )
        )
