"""What a picture's networks are asked and answer, with NumPy, pass by pass.

The compiled loops of `protocol/pictures` do the same; this is what their tests hold them to, and
what `train_probability_model` learns from.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from protocol.pictures.coefficient_context import (
    FIRST_SIGNED,
    LOG_TABLE,
    PAD,
    PASS_OFFSETS,
    POSITION_CELLS,
    TILE,
    ContextBand,
    ContextOffsets,
    context_offsets,
)
from protocol.pictures.probability_model import (
    CLASS_STARTS,
    HIDDEN_BITS,
    MAX_HIDDEN,
    MAX_LOGIT,
    SIGMOID,
    WEIGHT_BITS,
    BandPosition,
    Mlp,
    probability_models,
)
from shared_model.arrays import Array, Integers, Mask


def log_feature(magnitude: int) -> float:
    """A magnitude as the networks take it."""
    return float(LOG_TABLE[min(magnitude, len(LOG_TABLE) - 1)])


@dataclass(frozen=True, slots=True)
class CodingPass:
    """Positions of a grid that are coded together.

    number: index into `PASS_OFFSETS`.
    grid: (h, w).
    rows, columns: (n,) of the positions.
    """

    number: int
    grid: tuple[int, int]
    rows: Integers
    columns: Integers

    @property
    def position_cells(self) -> tuple[Integers, Integers]:
        """Cells 0..POSITION_CELLS - 1 of the positions: (n,) by rows, (n,) by columns."""
        height, width = self.grid
        return self.rows * POSITION_CELLS // height, self.columns * POSITION_CELLS // width

    def subset(self, chosen: Mask) -> "CodingPass":
        """The pass with the positions chosen (n,) alone."""
        return CodingPass(self.number, self.grid, self.rows[chosen], self.columns[chosen])


class CoefficientContext:
    """The values of a grid (h, w) that are known so far, and what predicts them.

    bands: (len(ContextBand), h, w).
    active: (h, w) the positions that are coded.
    tile_flags: (h, w) number of flagged tiles among the nine around a position; zeros while the
        flags themselves are coded.
    Attributes magnitudes, values: the grids of the features of magnitudes and of signs.
    """

    def __init__(self, bands: Integers, active: Mask, tile_flags: Integers) -> None:
        self._active = active
        height, width = self._shape = active.shape
        self._across = width + 2 * PAD
        inside = slice(PAD, PAD + height), slice(PAD, PAD + width)
        padded = height + 2 * PAD, self._across
        magnitudes = np.zeros((len(ContextBand) + 2, *padded), np.int64)
        magnitudes[(slice(1, -1), *inside)] = np.abs(bands)
        magnitudes[(-1, *inside)] = tile_flags
        values = np.zeros((1 + len(ContextBand) - FIRST_SIGNED, *padded), np.int64)
        values[(slice(1, None), *inside)] = bands[FIRST_SIGNED:]
        magnitude_offsets, sign_offsets = context_offsets(height, width)
        self.magnitudes = ContextTerms(magnitudes.ravel(), magnitude_offsets)
        self.values = ContextTerms(values.ravel(), sign_offsets)

    def passes(self) -> Iterator[CodingPass]:
        """Each pass that has active positions; call `set_known` before the next."""
        for number, (down, right) in enumerate(PASS_OFFSETS):
            rows, columns = np.nonzero(self._active[down::2, right::2])
            if len(rows):
                yield CodingPass(number, self._active.shape, 2 * rows + down, 2 * columns + right)

    def set_known(self, coding_pass: CodingPass, values: Integers) -> None:
        """Enter the values (n,) of a pass."""
        indices = (coding_pass.rows + PAD) * self._across + coding_pass.columns + PAD
        self.values.grids[indices] = values
        self.magnitudes.grids[indices] = np.abs(values)

    def magnitude_features(self, coding_pass: CodingPass) -> Array:
        """(n, MAGNITUDE_FEATURES) features of a pass's magnitudes, integers."""
        terms = self.magnitudes.gather(self.indices(coding_pass))
        sums = np.add.reduceat(terms, self.magnitudes.sums.starts, axis=1)
        return np.asarray(LOG_TABLE.take(sums, mode="clip"))

    def sign_features(self, coding_pass: CodingPass) -> Array:
        """(n, SIGN_FEATURES) features of a pass's signs, integers."""
        values = self.values.gather(self.indices(coding_pass))
        return np.asarray(np.sign(values) * LOG_TABLE.take(np.abs(values), mode="clip"))

    def indices(self, coding_pass: CodingPass) -> Integers:
        """(n, 2) index of each position in the padded grid, and of its mirror image."""
        row = (coding_pass.rows + PAD) * self._across + PAD
        mirrored = self._shape[1] - 1 - coding_pass.columns
        return np.array([row + coding_pass.columns, row + mirrored]).T


@dataclass(frozen=True, slots=True)
class ContextTerms:
    """Padded grids, joined to one flat array, and the sums that a context takes of their cells."""

    grids: Integers
    sums: ContextOffsets

    def gather(self, indices: Integers) -> Integers:
        """(n, terms) the terms of the sums at positions, see `CoefficientContext.indices`."""
        return np.asarray(self.grids.take(indices.take(self.sums.mirrored, 1) + self.sums.offsets))


def tile_sums(values: Integers) -> Integers:
    """(..., ceil(h / TILE), ceil(w / TILE)) sums over tiles of values (..., h, w)."""
    *others, height, width = values.shape
    # Faster than `reduceat`.
    rows = np.zeros((*others, -(-height // TILE), width), np.int64)
    for first in range(TILE):
        part = values[..., first::TILE, :]
        rows[..., : part.shape[-2], :] += part
    sums = np.zeros((*rows.shape[:-1], -(-width // TILE)), np.int64)
    for first in range(TILE):
        part = rows[..., first::TILE]
        sums[..., : part.shape[-1]] += part
    return sums


def class_rows(position: BandPosition, coding_pass: CodingPass) -> list[int]:
    """Rows of the class weights that all positions of a pass share."""
    own = (position.kind, position.plane, position.level, position.orientation, coding_pass.number)
    return [start + index for start, index in zip(CLASS_STARTS[: len(own)], own, strict=True)]


def pass_features(position: BandPosition, coding_pass: CodingPass) -> list[float]:
    """Features that all positions of a pass share."""
    return [log_feature(position.pictures), log_feature(coding_pass.grid[0])]


def pass_activation(mlp: Mlp, position: BandPosition, coding_pass: CodingPass) -> Array:
    """(h,) the part of the hidden sums that all positions of a pass share."""
    own = mlp.class_weights[class_rows(position, coding_pass)].sum(0)
    shared = np.array(pass_features(position, coding_pass)) @ mlp.pass_weights
    return np.asarray(own + shared)


def zero_probabilities(
    mlp: Mlp, features: Array, position: BandPosition, coding_pass: CodingPass
) -> Integers:
    """(n, outputs) probabilities of a zero, in 1/65536, from the features (n, f) of a pass."""
    rows, columns = coding_pass.position_cells
    hidden = features @ mlp.feature_weights
    hidden += pass_activation(mlp, position, coding_pass)
    hidden += mlp.row_weights.take(rows, 0)
    hidden += mlp.column_weights.take(columns, 0)
    hidden *= 2.0 ** (HIDDEN_BITS - WEIGHT_BITS)
    np.floor(hidden, out=hidden)
    np.clip(hidden, 0, MAX_HIDDEN, out=hidden)
    logits = hidden @ mlp.output_weights
    logits += mlp.output_bias
    logits *= 2.0**-WEIGHT_BITS
    np.floor(logits, out=logits)
    zeros = SIGMOID.take(logits.astype(np.int64) + MAX_LOGIT, mode="clip")
    return np.asarray(zeros, np.int64)


def network_probabilities(
    name: str, features: Array, position: BandPosition, coding_pass: CodingPass
) -> Integers:
    """`zero_probabilities` of the network of `ProbabilityModels` with this name."""
    return zero_probabilities(getattr(probability_models(), name), features, position, coding_pass)
