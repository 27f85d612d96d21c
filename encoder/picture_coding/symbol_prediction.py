"""Probabilities of a subband's symbols, in compiled loops.

The loops repeat the coding order and the context model of `protocol.pictures.coefficient_context`
and `probability_model`, which work on whole arrays.  All sums are exact integers;
tests/test_subband_coding.py checks that both give the same probabilities.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import jit
from protocol.pictures.coefficient_context import (
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

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

PASSES = len(PASS_OFFSETS)
_PASS_OFFSETS = np.array(PASS_OFFSETS)
_CLASS_STARTS = np.array(CLASS_STARTS)


class Predictor(NamedTuple):
    """What predicts one kind of symbol in grids of one size.

    offsets, mirrored, starts: see `coefficient_context.ContextOffsets`.
    *_weights, output_bias: see `probability_model.Mlp`.
    log_table, sigmoid: `LOG_TABLE` and `SIGMOID` of the same modules.
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
def list_positions(
    active: Bools, number: int, rows: Integers, columns: Integers, first: int
) -> int:
    """Write the active positions of a pass to `rows` and `columns` from index `first` on; returns
    the index after the last.

    active: (h, w).  number: of the pass.
    """
    for row in range(_PASS_OFFSETS[number, 0], active.shape[0], 2):
        for column in range(_PASS_OFFSETS[number, 1], active.shape[1], 2):
            if active[row, column]:
                rows[first], columns[first] = row, column
                first += 1
    return first


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
    hidden = np.empty(len(shared))
    classes, feature_weights = predictor.class_weights, predictor.feature_weights
    offsets, mirrored, starts = predictor.offsets, predictor.mirrored, predictor.starts
    log_table, last = predictor.log_table, len(predictor.log_table) - 1
    for k in range(len(rows)):
        row, column = rows[k], columns[k]
        row_class = _CLASS_STARTS[5] + row * POSITION_CELLS // height
        column_class = _CLASS_STARTS[6] + column * POSITION_CELLS // width
        for unit in range(len(hidden)):
            hidden[unit] = shared[unit] + classes[row_class, unit] + classes[column_class, unit]
        row_start = (row + PAD) * (width + 2 * PAD) + PAD
        # The position itself, and its mirror image on the other side of the face.
        centres = row_start + column, row_start + width - 1 - column
        for feature in range(len(starts)):
            end = starts[feature + 1] if feature + 1 < len(starts) else len(offsets)
            total = 0
            for term in range(starts[feature], end):
                total += grids[centres[mirrored[term]] + offsets[term]]
            if total:
                value = log_table[min(abs(total), last)]
                for unit in range(len(hidden)):
                    weighted = value * feature_weights[feature, unit]
                    hidden[unit] += weighted if total > 0 else -weighted
        _write_probabilities(
            hidden, predictor.output_weights, predictor.output_bias, predictor.sigmoid, p0[k]
        )


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
def _write_probabilities(
    hidden: Array, weights: Array, bias: Array, sigmoid: Integers, p0: Integers
) -> None:
    """Write the probabilities (outputs,) for hidden activations to `p0`."""
    logits = bias.copy()
    for unit in range(len(hidden)):
        value = np.floor(hidden[unit] * 2.0 ** (HIDDEN_BITS - WEIGHT_BITS))
        value = min(max(value, 0.0), MAX_HIDDEN)
        if value:
            for output in range(len(logits)):
                logits[output] += value * weights[unit, output]
    for output in range(len(logits)):
        logit = int(np.floor(logits[output] * 2.0**-WEIGHT_BITS))
        p0[output] = sigmoid[min(max(logit + MAX_LOGIT, 0), len(sigmoid) - 1)]
