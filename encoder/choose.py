"""Which integers a picture's wavelet coefficients become: rate-distortion optimised.

A coefficient takes the nearest integer, the one below, or zero: what costs least of squared error,
in steps, and `LAGRANGIAN` times bits, by the very probabilities that will code it.  Of a still's
coarsest subband it takes the nearest; a tile without a coefficient worth it is left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from encoder.compiled import compiled
from protocol.adaptive import AdaptiveIntegers
from protocol.coefficients import (
    MAX_SIZE,
    STEP_OUTPUTS,
    UNARY,
    code_bits_each,
    code_coarse,
    code_sizes,
)
from protocol.entropy import WHOLE, RangeEncoder
from protocol.foresee import Site
from protocol.subbands import TOWARDS_ZERO, Pyramid, Series, plane_shape
from protocol.surroundings import Turn, by_tile
from protocol.values import BitCoder

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LAGRANGIAN = 0.12
# A tile is worth its bits if it has a coefficient of more than this many steps.
WORTH_A_TILE = 0.85
# What a sign is taken to cost before it is known, bits.
SIGN_BITS = 0.9
# What a zero costs by its probability in 1 / 65536.
_ZERO_BITS = -np.log2(np.maximum(np.arange(WHOLE), 0.5) / WHOLE)


def choose(
    series: Series, coefficients: Sequence[tuple[Array, list[list[Array]]]]
) -> tuple[list[Pyramid], "Tape"]:
    """The integers of a picture's planes as the next of `series`, which goes on to it.

    coefficients: of each plane in steps, as `wavelet.transform` has them.
    """
    tape = Tape()
    pyramids = series.code([_Chooser(tape, *plane) for plane in coefficients])
    series.learn(pyramids)
    return pyramids, tape


class Tape:
    """What was decided, in order, to be coded later, and its bits."""

    def __init__(self) -> None:
        self._steps: list[Callable[[BitCoder], object]] = []
        self.bits = 0.0

    def add(self, step: Callable[[BitCoder], object], bits: float) -> None:
        """A decision."""
        self._steps.append(step)
        self.bits += bits

    def write(self) -> bytes:
        """The bytes of all decisions."""
        coder = RangeEncoder()
        for step in self._steps:
            step(coder)
        return coder.finish()


class _Pairs:
    """A coder that keeps what it is given: bits, and their probabilities of a zero."""

    def __init__(self) -> None:
        self._kept: list[tuple[int, int]] = []

    def code_bit(self, bit: int, zero: int) -> int:
        """Keep `bit`; returns it."""
        self._kept.append((bit, zero))
        return bit

    @property
    def both(self) -> tuple[Integers, Integers]:
        """(n,) bits, and (n,) probabilities."""
        bits, zeros = np.array(self._kept, np.int64).reshape(-1, 2).T
        return bits, zeros


@dataclass(frozen=True, slots=True)
class _Chooser:
    """Decides on a plane; its coefficients in steps, as `wavelet.transform` has them."""

    tape: Tape
    rough: Array
    details: list[list[Array]]
    _worth: dict[Site, Integers] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        return plane_shape(self.details)

    def coarse(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        pairs = _Pairs()
        values = code_coarse(pairs, integers, context, np.rint(self.rough).astype(np.int64))
        self._certain(*pairs.both)
        return values

    def flags(self, site: Site, zeros: Integers, turn: Turn) -> Integers:
        if site not in self._worth:
            worth = by_tile((np.abs(self._band(site)) > WORTH_A_TILE).astype(np.int64))
            self._worth[site] = (worth > 0).astype(np.int64)
        return self._certain(self._worth[site][turn.rows, turn.columns], zeros)

    def sizes(self, site: Site, zeros: Integers, turn: Turn) -> Integers:
        wanted = np.abs(self._band(site)[turn.rows, turn.columns])
        shift = TOWARDS_ZERO if site.level else 0.0
        sizes, bits = _cheapest(wanted, zeros, shift, _ZERO_BITS)
        self.tape.add(partial(code_sizes, sizes=sizes, zeros=zeros), bits)
        return sizes

    def signs(self, site: Site, zeros: Integers, turn: Turn) -> Integers:
        negative = self._band(site)[turn.rows, turn.columns] < 0
        return self._certain(negative.astype(np.int64), zeros)

    def _band(self, site: Site) -> Array:
        return site.of(self.rough, self.details)

    def _certain(self, bits: Integers, zeros: Integers) -> Integers:
        """Bits that leave no choice."""
        cost = float(_ZERO_BITS.take(np.where(bits, WHOLE - zeros, zeros)).sum())
        self.tape.add(partial(code_bits_each, bits=bits, zeros=zeros), cost)
        return bits


@compiled
def _cheapest(
    wanted: Array, zeros: Integers, shift: float, zero_bits: Array
) -> tuple[Integers, float]:
    """(n,) sizes for coefficients of `wanted` (n,) >= 0 steps, and the bits of all without signs.

    zeros: (n, outputs), see `foresee.Networks`.  shift: by how much nearer to zero a size is
    restored.  zero_bits: see `_ZERO_BITS`.
    """
    found = np.zeros(len(wanted), np.int64)
    total = 0.0
    for place in range(len(wanted)):
        nearest = min(int(wanted[place] + 0.5), MAX_SIZE) if wanted[place] > 0.5 else 0
        bits = zero_bits[zeros[place, 0]]
        least = wanted[place] ** 2 + LAGRANGIAN * bits
        for size in range(max(nearest - 1, 1), nearest + 1):
            cost = _size_bits(size, zeros[place], zero_bits)
            away = wanted[place] - size + shift
            all_in_all = away * away + LAGRANGIAN * (cost + SIGN_BITS)
            if all_in_all < least:
                found[place], least, bits = size, all_in_all, cost
        total += bits
    return found, total


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
