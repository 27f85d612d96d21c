"""Probabilities of wavelet coefficients in compiled loops: encoders code a picture many times."""

import numpy as np
from numpy.typing import NDArray

from encoder.compiled import compiled
from protocol.foresee import (
    HIDDEN_BITS,
    LOGITS,
    MOST_HIDDEN,
    SQUASHED,
    WEIGHT_BITS,
    Network,
    Site,
    networks,
)
from protocol.subbands import Series
from protocol.surroundings import LOGARITHM, Surroundings, Terms, Turn

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class CompiledSeries(Series):
    """A `Series` that foretells the same sooner: all sums are integers, and exact."""

    __slots__ = ()

    def foretold_tiles(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return _foretold(networks().tiles, around, around.sizes, site, turn)[:, 0]

    def foretold_sizes(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return _foretold(networks().sizes, around, around.sizes, site, turn)

    def foretold_signs(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return _foretold(networks().signs, around, around.values, site, turn)[:, 0]


def _foretold(
    network: Network, around: Surroundings, terms: Terms, site: Site, turn: Turn
) -> Integers:
    """(n, outputs) what `Network.zeros` makes of the features of a turn."""
    sums = terms.sums
    features = _features(
        terms.grids, around.places(turn), sums.offsets, sums.sides, sums.starts, LOGARITHM
    )
    return _zeros(
        features,
        *turn.cells,
        network.features,
        network.common(site, turn),
        network.rows,
        network.columns,
        network.last,
        network.added,
        SQUASHED,
    )


@compiled
def _features(
    grids: Integers,
    places: Integers,
    offsets: Integers,
    sides: Integers,
    starts: Integers,
    logarithm: Array,
) -> Array:
    """(n, f) logarithms of sums, with their signs, see `Surroundings`."""
    found = np.empty((len(places), len(starts)))
    for place in range(len(places)):
        for feature in range(len(starts)):
            end = starts[feature + 1] if feature + 1 < len(starts) else len(offsets)
            total = 0
            for term in range(starts[feature], end):
                total += grids[places[place, sides[term]] + offsets[term]]
            size = logarithm[min(abs(total), len(logarithm) - 1)]
            found[place, feature] = size if total >= 0 else -size
    return found


@compiled
def _zeros(
    features: Array,
    row_cells: Integers,
    column_cells: Integers,
    weights: Array,
    common: Array,
    rows: Array,
    columns: Array,
    last: Array,
    added: Array,
    squashed: Integers,
) -> Integers:
    """(n, outputs) probabilities, see `Network.zeros`."""
    found = np.empty((len(features), last.shape[1]), np.int64)
    hidden, logits = np.empty(len(common)), np.empty(len(added))
    for place in range(len(features)):
        row, column = row_cells[place], column_cells[place]
        for unit in range(len(hidden)):
            hidden[unit] = common[unit] + rows[row, unit] + columns[column, unit]
        for feature in range(features.shape[1]):
            value = features[place, feature]
            if value:
                for unit in range(len(hidden)):
                    hidden[unit] += value * weights[feature, unit]
        logits[:] = added
        for unit in range(len(hidden)):
            value = np.floor(hidden[unit] * 2.0 ** (HIDDEN_BITS - WEIGHT_BITS))
            value = min(max(value, 0.0), MOST_HIDDEN)
            if value:
                for output in range(len(logits)):
                    logits[output] += value * last[unit, output]
        for output in range(len(logits)):
            logit = int(np.floor(logits[output] * 2.0**-WEIGHT_BITS))
            found[place, output] = squashed[min(max(logit + LOGITS, 0), len(squashed) - 1)]
    return found
