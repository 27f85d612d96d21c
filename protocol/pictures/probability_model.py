"""Probabilities of wavelet coefficients from a small multilayer perceptron (MLP).

An MLP has one hidden layer.  Weights and inputs are integers and all sums stay far below 2 ** 53,
so floating-point arithmetic is exact and both ends find the same probabilities.  The tables of
logarithms and of the sigmoid come from `log2` and `exp`; no value lies within 3e-4 of a rounding
boundary.  The weights are part of the format: other weights need other format numbers.
`assets/train_probability_model.py` trains them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TypeVar

import numpy as np

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.pictures.coefficient_context import PASS_OFFSETS, POSITION_CELLS
from protocol.pictures.wavelet import LEVELS
from shared_model.arrays import Array, Integers

Band = TypeVar("Band")

# Kinds of pictures.
BACKGROUND, TEXTURE, MODE = range(3)
# Orientation of the lowpass band; details have 0..2.
LOWPASS = 3
# Classes of a position: numbers of kinds, planes, levels, orientations and passes, and the first
# row of each in the array of class weights.  The cells by rows and by columns come last.
_COUNTS = (3, 3, 1 + LEVELS, 1 + LOWPASS, len(PASS_OFFSETS), POSITION_CELLS)
CLASS_STARTS = np.cumsum([0, *_COUNTS]).tolist()
CLASS_COUNT = CLASS_STARTS[-1] + POSITION_CELLS
# Hidden values are in 1 / 2 ** HIDDEN_BITS of an octave of magnitude, logits in
# 1 / 2 ** LOGIT_BITS; the sums that make either have WEIGHT_BITS more.
WEIGHT_BITS, HIDDEN_BITS, LOGIT_BITS = 13, 4, 8
# Bounds the sums of the output layer.
MAX_HIDDEN = 1 << 14
MAX_LOGIT = 8 << LOGIT_BITS
# Of 65536.
MIN_PROBABILITY = 24
# Arrays of an MLP in the weights' file, after the MLP's name.
WEIGHT_ARRAYS = ("features", "classes", "last")


@dataclass(frozen=True, slots=True)
class BandPosition:
    """The position of a subband in a sequence of pictures.

    kind: `BACKGROUND`, `TEXTURE` or `MODE`.
    plane: 0 luma, 1 and 2 colour differences.
    level: 0 the lowpass band, 1 the coarsest details, `LEVELS` the finest.
    orientation: of details 0 (high horizontal frequencies), 1 (vertical), 2 (both); or `LOWPASS`.
    pictures: number of previous pictures in the sequence.
    """

    kind: int
    plane: int
    level: int
    orientation: int
    pictures: int = 0

    def select(self, lowpass: Band, details: Sequence[Sequence[Band]]) -> Band:
        """The band of this level and orientation among those of a plane."""
        return details[self.level - 1][self.orientation] if self.level else lowpass


class Mlp:
    """A multilayer perceptron: probabilities of zeros from the features of positions.

    features: (f + 2, h) weights of the features; the last two rows are of `pass_features`.
    classes: (CLASS_COUNT, h) weights of the classes, one row each.
    last: (h + 1, outputs) weights of the hidden values; the last row is the bias.
    """

    def __init__(self, features: Array, classes: Array, last: Array) -> None:
        self.feature_weights, self.pass_weights = features[:-2], features[-2:]
        self.class_weights = classes
        self.row_weights = classes[CLASS_STARTS[-2] : CLASS_STARTS[-1]]
        self.column_weights = classes[CLASS_STARTS[-1] :]
        self.output_weights, self.output_bias = last[:-1], last[-1]


def _sigmoid_table() -> Integers:
    logits = np.arange(-MAX_LOGIT, MAX_LOGIT + 1) / 2**LOGIT_BITS
    zeros = np.rint(PROBABILITY_ONE / (1 + np.exp(-logits)))
    return np.asarray(np.clip(zeros, MIN_PROBABILITY, PROBABILITY_ONE - MIN_PROBABILITY), np.int64)


SIGMOID = _sigmoid_table()


@dataclass(frozen=True, slots=True)
class ProbabilityModels:
    """The MLPs of tile flags, of the unary decisions of magnitudes, and of signs.

    The six outputs of `sizes` are for the decisions "is the magnitude 0?", "1?", "2?", "3?" and
    "4?", "5?" to "8?", and all further ones, see `coefficient_coding.STEP_OUTPUTS`.
    """

    tiles: Mlp
    sizes: Mlp
    signs: Mlp


@lru_cache
def probability_models() -> ProbabilityModels:
    """The MLPs with the weights of the format."""
    with files("protocol").joinpath("data/probability_model.npz").open("rb") as file:
        stored = np.load(file)
        return ProbabilityModels(
            *(
                Mlp(*(stored[f"{name}_{part}"].astype(np.float64) for part in WEIGHT_ARRAYS))
                for name in ProbabilityModels.__slots__
            )
        )
