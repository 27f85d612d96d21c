"""Probabilities of a subband's symbols, in compiled loops.

The loops repeat the coding order and the context model of `protocol.pictures.coefficient_context`
and `probability_model`, which work on whole arrays.  All sums are exact integers;
tests/test_protocol/pictures/test_subband_coding.py checks that both give the same probabilities.
"""

from typing import NamedTuple

import numpy as np

from protocol.pictures.coefficient_context import (
    FIRST_SIGNED,
    LOG_TABLE,
    PAD,
    PASS_OFFSETS,
    POSITION_CELLS,
    ContextOffsets,
)
from protocol.pictures.probability_model import (
    CLASS_STARTS,
    HIDDEN_BITS,
    MAX_HIDDEN,
    MAX_LOGIT,
    SIGMOID,
    WEIGHT_BITS,
    Mlp,
)
from runtime.jit import jit
from shared_model.arrays import Array, Integers, Mask

PASSES = len(PASS_OFFSETS)
_PASS_OFFSETS = np.array(PASS_OFFSETS)
_CLASS_STARTS = np.array(CLASS_STARTS)


class Predictor(NamedTuple):
    """What predicts one kind of symbol in grids of one size.

    offsets, mirrored, starts: see `coefficient_context.ContextOffsets`.
    *_weights, output_bias: see `probability_model.Mlp`.
    log_table, sigmoid: `coefficient_context.LOG_TABLE` and `probability_model.SIGMOID`.
    """

    offsets: Integers
    mirrored: Integers
    starts: Integers
    feature_weights: Array
    pass_weights: Array
    class_weights: Array
    output_weights: Array
    output_bias: Array
    log_table: Array
    sigmoid: Integers


def make_predictor(mlp: Mlp, context: ContextOffsets) -> Predictor:
    """The predictor with the weights of `mlp`, for grids of the size of `context`."""
    return Predictor(
        context.offsets,
        context.mirrored,
        context.starts,
        mlp.feature_weights,
        mlp.pass_weights,
        mlp.class_weights,
        mlp.output_weights,
        mlp.output_bias,
        LOG_TABLE,
        SIGMOID,
    )


@jit
def list_positions(active: Mask) -> tuple[Integers, Integers, Integers]:
    """The active positions of a grid (h, w) in coding order: rows (n,), columns (n,), and the index
    of each pass' first position and of the end (PASSES + 1,)."""
    count = active.sum()
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    starts, index = np.zeros(PASSES + 1, np.int64), 0
    for number in range(PASSES):
        for row in range(_PASS_OFFSETS[number, 0], active.shape[0], 2):
            for column in range(_PASS_OFFSETS[number, 1], active.shape[1], 2):
                if active[row, column]:
                    rows[index], columns[index] = row, column
                    index += 1
        starts[number + 1] = index
    return rows, columns, starts


@jit
def context_grids(context_bands: Integers, active_around: Integers) -> tuple[Integers, Integers]:
    """Padded grids, flat, that magnitudes and signs are predicted from; grid 0, the band itself, is
    zero at first."""
    _, height, width = context_bands.shape
    magnitudes = np.zeros((len(context_bands) + 2, height + 2 * PAD, width + 2 * PAD), np.int64)
    magnitudes[1:-1, PAD:-PAD, PAD:-PAD] = np.abs(context_bands)
    magnitudes[-1, PAD:-PAD, PAD:-PAD] = active_around
    values = np.zeros(
        (1 + len(context_bands) - FIRST_SIGNED, height + 2 * PAD, width + 2 * PAD), np.int64
    )
    values[1:, PAD:-PAD, PAD:-PAD] = context_bands[FIRST_SIGNED:]
    return magnitudes.ravel(), values.ravel()


@jit
def add_to_context(
    rows: Integers,
    columns: Integers,
    values: Integers,
    magnitude_grids: Integers,
    value_grids: Integers,
) -> None:
    """Make the values (h, w) at positions (n,) of a pass context of later passes."""
    for k in range(len(rows)):
        value = values[rows[k], columns[k]]
        padded = (rows[k] + PAD) * (values.shape[1] + 2 * PAD) + columns[k] + PAD
        magnitude_grids[padded] = abs(value)
        value_grids[padded] = value


@jit
def predict(
    predictor: Predictor,
    band: Integers,
    number: int,
    grids: Integers,
    shape: tuple[int, int],
    rows: Integers,
    columns: Integers,
    p0: Integers,
) -> None:
    """Write the probabilities (n, outputs) of the symbols at positions (n,) of a pass to `p0`.

    band: (5,) the fields of the band's `BandPosition`.  number: of the pass.
    grids: the padded context grids, flat.  shape: (h, w) of one grid without its padding.
    """
    height, width = shape
    shared = _shared_activation(predictor, band, number, height)
    hidden, logits = np.empty(len(shared)), np.empty(p0.shape[1])
    classes, features = predictor.class_weights, predictor.feature_weights
    offsets, mirrored, starts = predictor.offsets, predictor.mirrored, predictor.starts
    weights, bias, sigmoid = predictor.output_weights, predictor.output_bias, predictor.sigmoid
    log_table = predictor.log_table
    for k in range(len(rows)):
        row, column = rows[k], columns[k]
        row_class = _CLASS_STARTS[5] + row * POSITION_CELLS // height
        column_class = _CLASS_STARTS[6] + column * POSITION_CELLS // width
        for unit in range(len(hidden)):
            hidden[unit] = shared[unit] + classes[row_class, unit] + classes[column_class, unit]
        row_start = (row + PAD) * (width + 2 * PAD) + PAD
        # The position itself, and its mirror image on the other side of the face.
        centres = row_start + column, row_start + width - 1 - column
        _add_features(grids, centres, offsets, mirrored, starts, log_table, features, hidden)
        _write_probabilities(hidden, weights, bias, sigmoid, logits, p0[k])


@jit
def _shared_activation(predictor: Predictor, band: Integers, number: int, height: int) -> Array:
    """(hidden,) the part of the hidden activations that all positions of a pass share."""
    classes, last = predictor.class_weights, len(predictor.log_table) - 1
    shared: Array = predictor.log_table[min(band[4], last)] * predictor.pass_weights[0]
    shared += predictor.log_table[min(height, last)] * predictor.pass_weights[1]
    for kind in range(4):
        shared += classes[_CLASS_STARTS[kind] + band[kind]]
    shared += classes[_CLASS_STARTS[4] + number]
    return shared


@jit
def _add_features(
    grids: Integers,
    centres: tuple[int, int],
    offsets: Integers,
    mirrored: Integers,
    starts: Integers,
    log_table: Array,
    weights: Array,
    hidden: Array,
) -> None:
    """Add the contributions of a position's context to its hidden activations.

    centres: indices of the position and of its mirror image in the first grid.
    """
    last = len(log_table) - 1
    for feature in range(len(starts)):
        end = starts[feature + 1] if feature + 1 < len(starts) else len(offsets)
        total = 0
        for term in range(starts[feature], end):
            total += grids[centres[mirrored[term]] + offsets[term]]
        if not total:
            continue
        value = log_table[min(abs(total), last)]
        if total < 0:
            value = -value
        for unit in range(len(hidden)):
            hidden[unit] += value * weights[feature, unit]


@jit
def _write_probabilities(
    hidden: Array, weights: Array, bias: Array, sigmoid: Integers, logits: Array, p0: Integers
) -> None:
    """Write the probabilities (outputs,) for hidden activations to `p0`; overwrites `logits`."""
    logits[:] = bias
    for unit in range(len(hidden)):
        value = np.floor(hidden[unit] * 2.0 ** (HIDDEN_BITS - WEIGHT_BITS))
        value = min(max(value, 0.0), MAX_HIDDEN)
        if value:
            for output in range(len(logits)):
                logits[output] += value * weights[unit, output]
    for output in range(len(logits)):
        logit = int(np.floor(logits[output] * 2.0**-WEIGHT_BITS))
        p0[output] = sigmoid[min(max(logit + MAX_LOGIT, 0), len(sigmoid) - 1)]
