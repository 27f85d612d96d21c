"""What becomes of a subband of a picture, in compiled loops: encoders code a picture many times.

A coefficient takes the nearest integer, the one below, or zero: what costs least of squared error,
in steps, and `LAGRANGIAN` times bits, by the very probabilities that will code it.  A tile without
a coefficient worth it is left out.

The order of places and their probabilities stand here a second time: `subband_coding`,
`coefficient_context` and `probability_model` have them as arrays, for decoders.  All sums are
integers, and exact; tests/test_subband_coding.py holds the two together.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import compiled
from protocol.entropy.range_coder import WHOLE
from protocol.pictures.coefficient_coding import MAX_SIZE, STEP_OUTPUTS, UNARY
from protocol.pictures.coefficient_context import (
    CELLS,
    LOGARITHM,
    PAD,
    SIGNED,
    SMALL_BAND,
    TILE,
    TURNS,
    Sums,
    sums_around,
)
from protocol.pictures.probability_model import (
    HIDDEN_BITS,
    LOGITS,
    MOST_HIDDEN,
    SQUASHED,
    STARTS,
    WEIGHT_BITS,
    Network,
    Site,
    networks,
)
from protocol.pictures.subband_coding import TOWARDS_ZERO

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

# Squared steps that a bit is worth.
LAGRANGIAN = 0.12
# A tile is worth its bits if it has a coefficient of more than this many steps.
WORTH_A_TILE = 0.85
# What a sign is taken to cost before it is known, bits.
SIGN_BITS = 0.9
# What a zero costs by its probability in 1 / 65536.
ZERO_BITS = -np.log2(np.maximum(np.arange(WHOLE), 0.5) / WHOLE)
_TURNS = np.array(TURNS)
_STARTS = np.array(STARTS)


class Decisions(NamedTuple):
    """What was decided on a band, in order.

    values: (h, w).
    flags: (f,) of tiles, turn by turn; flag_zeros: (f,) their probabilities.
    sizes: (n,); size_zeros: (n, outputs), see `foresee.Networks`.
    signs: (s,) of sizes that are not zero; sign_zeros: (s,).
    ends: (turns, 2) how many sizes and signs there are up to each turn's end.
    bits: of all.
    """

    values: Integers
    flags: Integers
    flag_zeros: Integers
    sizes: Integers
    size_zeros: Integers
    signs: Integers
    sign_zeros: Integers
    ends: Integers
    bits: float


class _Weights(NamedTuple):
    """A `foresee.Network`, see there."""

    features: Array
    of_all: Array
    classes: Array
    last: Array
    added: Array


class _Places(NamedTuple):
    """`surroundings.Sums`, see there."""

    offsets: Integers
    sides: Integers
    starts: Integers


class _Tables(NamedTuple):
    """`surroundings.LOGARITHM`, `foresee.SQUASHED` and `ZERO_BITS`."""

    logarithm: Array
    squashed: Integers
    zero_bits: Array


_TABLES = _Tables(LOGARITHM, SQUASHED, ZERO_BITS)


def choose_band(site: Site, wanted: Array, sources: Integers) -> Decisions:
    """What is decided on a band of coefficients `wanted` (h, w), in steps.

    sources: (len(Source), h, w), see `Surroundings`.
    """
    height, width = wanted.shape
    tiles = -(-height // TILE), -(-width // TILE)
    around_tiles, _ = sums_around(*tiles)
    around_sizes, around_signs = sums_around(height, width)
    known = networks()
    return Decisions(
        *_band(
            np.ascontiguousarray(wanted),
            sources,
            np.array([site.kind, site.plane, site.level, site.orientation, site.pictures]),
            TOWARDS_ZERO if site.level else 0.0,
            (_weights(known.tiles), _weights(known.sizes), _weights(known.signs)),
            (_places(around_tiles), _places(around_sizes), _places(around_signs)),
            _TABLES,
        )
    )


def _weights(network: Network) -> _Weights:
    return _Weights(network.features, network.of_all, network.classes, network.last, network.added)


def _places(sums: Sums) -> _Places:
    return _Places(sums.offsets, sums.sides, sums.starts)


@compiled
def _band(
    wanted: Array,
    sources: Integers,
    site: Integers,
    shift: float,
    weights: tuple[_Weights, _Weights, _Weights],
    places: tuple[_Places, _Places, _Places],
    tables: _Tables,
) -> tuple[Integers, Integers, Integers, Integers, Integers, Integers, Integers, Integers, float]:
    """See `choose_band`.  site: (5,).  weights, places: of tiles, sizes and signs."""
    height, width = wanted.shape
    flags, coded_flags, flag_zeros, total = _flags(
        wanted, sources, site, weights[0], places[0], tables
    )
    active, busy = _spread(flags, height, width)
    wide = np.zeros((len(sources) + 2, height + 2 * PAD, width + 2 * PAD), np.int64)
    wide[1:-1, PAD:-PAD, PAD:-PAD] = np.abs(sources)
    wide[-1, PAD:-PAD, PAD:-PAD] = busy
    sizes_around = wide.ravel()
    wide = np.zeros((1 + len(sources) - SIGNED, height + 2 * PAD, width + 2 * PAD), np.int64)
    wide[1:, PAD:-PAD, PAD:-PAD] = sources[SIGNED:]
    values_around = wide.ravel()
    values = np.zeros((height, width), np.int64)
    count, outputs = active.sum(), len(weights[1].added)
    sizes, size_zeros = np.zeros(count, np.int64), np.zeros((count, outputs), np.int64)
    signs, sign_zeros = np.zeros(count, np.int64), np.zeros(count, np.int64)
    rows, columns = np.zeros(count, np.int64), np.zeros(count, np.int64)
    ends = np.zeros((len(_TURNS), 2), np.int64)
    first, signed = 0, 0
    for turn in range(len(_TURNS)):
        end = _places_of(active, turn, rows, columns, first)
        common = _common(weights[1], site, turn, height)
        _foretell(
            weights[1], common, places[1], sizes_around, rows[first:end], columns[first:end],
            height, width, tables, size_zeros[first:end],
        )  # fmt: skip
        total += _cheapest(
            wanted, rows[first:end], columns[first:end], size_zeros[first:end], shift,
            tables.zero_bits, sizes[first:end],
        )  # fmt: skip
        some = np.nonzero(sizes[first:end])[0] + first
        before, signed = signed, signed + len(some)
        found = np.zeros((len(some), 1), np.int64)
        common = _common(weights[2], site, turn, height)
        _foretell(
            weights[2], common, places[2], values_around, rows[some], columns[some],
            height, width, tables, found,
        )  # fmt: skip
        for number in range(len(some)):
            place = some[number]
            row, column, zero = rows[place], columns[place], found[number, 0]
            negative = wanted[row, column] < 0
            signs[before + number], sign_zeros[before + number] = negative, zero
            total += tables.zero_bits[WHOLE - zero if negative else zero]
            value = -sizes[place] if negative else sizes[place]
            values[row, column] = value
        # What a turn holds is known after all of it.
        for place in some:
            at = (rows[place] + PAD) * (width + 2 * PAD) + columns[place] + PAD
            sizes_around[at] = sizes[place]
            values_around[at] = values[rows[place], columns[place]]
        ends[turn, 0], ends[turn, 1] = end, signed
        first = end
    return (
        values, coded_flags, flag_zeros, sizes, size_zeros, signs[:signed], sign_zeros[:signed],
        ends, total,
    )  # fmt: skip


@compiled
def _flags(
    wanted: Array,
    sources: Integers,
    site: Integers,
    weights: _Weights,
    places: _Places,
    tables: _Tables,
) -> tuple[Integers, Integers, Integers, float]:
    """Which tiles hold anything (h, w); these flags as they are coded and their probabilities
    (n,); and the bits of all."""
    height, width = -(-wanted.shape[0] // TILE), -(-wanted.shape[1] // TILE)
    if height * width * TILE**2 <= SMALL_BAND:
        none = np.zeros(0, np.int64)
        return np.ones((height, width), np.int64), none, none, 0.0
    flags = np.zeros((height, width), np.int64)
    wide = np.zeros((len(sources) + 2, height + 2 * PAD, width + 2 * PAD), np.int64)
    for row in range(wanted.shape[0]):
        for column in range(wanted.shape[1]):
            tile = row // TILE, column // TILE
            if abs(wanted[row, column]) > WORTH_A_TILE:
                flags[tile] = 1
            for source in range(len(sources)):
                size = abs(sources[source, row, column])
                wide[1 + source, PAD + tile[0], PAD + tile[1]] += size
    around = wide.ravel()
    coded, zeros = np.zeros(height * width, np.int64), np.zeros((height * width, 1), np.int64)
    rows, columns = np.zeros(height * width, np.int64), np.zeros(height * width, np.int64)
    every = np.ones((height, width), np.bool_)
    first, total = 0, 0.0
    for turn in range(len(_TURNS)):
        end = _places_of(every, turn, rows, columns, first)
        common = _common(weights, site, turn, height)
        _foretell(
            weights, common, places, around, rows[first:end], columns[first:end],
            height, width, tables, zeros[first:end],
        )  # fmt: skip
        for place in range(first, end):
            row, column, zero = rows[place], columns[place], zeros[place, 0]
            coded[place] = flags[row, column]
            total += tables.zero_bits[WHOLE - zero if coded[place] else zero]
            around[(row + PAD) * (width + 2 * PAD) + column + PAD] = coded[place]
        first = end
    return flags, coded, zeros[:, 0].copy(), total


@compiled
def _spread(flags: Integers, height: int, width: int) -> tuple[Bools, Integers]:
    """(h, w) flags of tiles, and sums of those around, as each coefficient has them."""
    active = np.zeros((height, width), np.bool_)
    busy = np.zeros((height, width), np.int64)
    for row in range(height):
        for column in range(width):
            i, j = row // TILE, column // TILE
            active[row, column] = flags[i, j] > 0
            busy[row, column] = flags[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].sum()
    return active, busy


@compiled
def _places_of(active: Bools, turn: int, rows: Integers, columns: Integers, first: int) -> int:
    """Writes a turn's places from number `first` on; returns the number after the last."""
    for row in range(_TURNS[turn, 0], active.shape[0], 2):
        for column in range(_TURNS[turn, 1], active.shape[1], 2):
            if active[row, column]:
                rows[first], columns[first] = row, column
                first += 1
    return first


@compiled
def _common(weights: _Weights, site: Integers, turn: int, height: int) -> Array:
    """(h,) what all places of a turn add to the hidden values, see `Network.common`."""
    classes, last = weights.classes, len(LOGARITHM) - 1
    common: Array = LOGARITHM[min(site[4], last)] * weights.of_all[0]
    common += LOGARITHM[min(height, last)] * weights.of_all[1]
    for kind in range(4):
        common += classes[_STARTS[kind] + site[kind]]
    common += classes[_STARTS[4] + turn]
    return common


@compiled
def _foretell(
    weights: _Weights,
    common: Array,
    around: _Places,
    grids: Integers,
    rows: Integers,
    columns: Integers,
    height: int,
    width: int,
    tables: _Tables,
    zeros: Integers,
) -> None:
    """Writes probabilities (n, outputs) of what stands at places (n,), see `Network.zeros`."""
    hidden, logits = np.empty(len(common)), np.empty(len(weights.added))
    starts, logarithm = around.starts, tables.logarithm
    for place in range(len(rows)):
        row, column = rows[place], columns[place]
        at = (row + PAD) * (width + 2 * PAD) + PAD
        here = at + column, at + width - 1 - column
        own_row = _STARTS[5] + row * CELLS // height
        own_column = _STARTS[6] + column * CELLS // width
        for unit in range(len(hidden)):
            hidden[unit] = (
                common[unit] + weights.classes[own_row, unit] + weights.classes[own_column, unit]
            )
        for feature in range(len(starts)):
            end = starts[feature + 1] if feature + 1 < len(starts) else len(around.offsets)
            total = 0
            for term in range(starts[feature], end):
                total += grids[here[around.sides[term]] + around.offsets[term]]
            if not total:
                continue
            value = logarithm[min(abs(total), len(logarithm) - 1)]
            if total < 0:
                value = -value
            for unit in range(len(hidden)):
                hidden[unit] += value * weights.features[feature, unit]
        logits[:] = weights.added
        for unit in range(len(hidden)):
            value = np.floor(hidden[unit] * 2.0 ** (HIDDEN_BITS - WEIGHT_BITS))
            value = min(max(value, 0.0), MOST_HIDDEN)
            if value:
                for output in range(len(logits)):
                    logits[output] += value * weights.last[unit, output]
        for output in range(len(logits)):
            logit = int(np.floor(logits[output] * 2.0**-WEIGHT_BITS))
            reach = min(max(logit + LOGITS, 0), len(tables.squashed) - 1)
            zeros[place, output] = tables.squashed[reach]


@compiled
def _cheapest(
    band: Array,
    rows: Integers,
    columns: Integers,
    zeros: Integers,
    shift: float,
    zero_bits: Array,
    found: Integers,
) -> float:
    """Writes the sizes (n,) that cost least for what stands at places (n,) of a band, in steps;
    returns the bits of all without signs.

    zeros: (n, outputs), see `foresee.Networks`.  shift: by how much nearer to zero a size is
    restored.  zero_bits: see `ZERO_BITS`.
    """
    total = 0.0
    for place in range(len(rows)):
        wanted = abs(band[rows[place], columns[place]])
        nearest = min(int(wanted + 0.5), MAX_SIZE) if wanted > 0.5 else 0
        bits = zero_bits[zeros[place, 0]]
        least = wanted**2 + LAGRANGIAN * bits
        for size in range(max(nearest - 1, 1), nearest + 1):
            cost = _size_bits(size, zeros[place], zero_bits)
            away = wanted - size + shift
            all_in_all = away * away + LAGRANGIAN * (cost + SIGN_BITS)
            if all_in_all < least:
                found[place], least, bits = size, all_in_all, cost
        total += bits
    return total


@compiled
def _size_bits(size: int, zeros: Integers, zero_bits: Array) -> float:
    """Bits of one size without its sign; zeros: (outputs,)."""
    bits = 0.0
    for step in range(min(size, UNARY)):
        bits += zero_bits[WHOLE - zeros[STEP_OUTPUTS[step]]]
    if size < UNARY:
        return float(bits + zero_bits[zeros[STEP_OUTPUTS[size]]])
    length = int(np.log2(size - UNARY + 1))
    return float(bits + 2 * length + 1)
