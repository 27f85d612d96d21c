"""Which integers a picture's wavelet coefficients become: rate-distortion optimised.

Each coefficient takes the nearest integer, the one below, or zero: what costs least of squared
error, in steps, and `LAGRANGIAN` times bits, by the very probabilities that will code it.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from protocol.adaptive import AdaptiveIntegers
from protocol.entropy import WHOLE, RangeEncoder
from protocol.foresee import Site
from protocol.subbands import (
    STEP_OUTPUTS,
    TOWARDS_ZERO,
    UNARY,
    Pyramid,
    Series,
    blank,
    code_bits_each,
    code_coarse,
    code_sizes,
)
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
_STEPS = np.array(STEP_OUTPUTS)
# (UNARY, outputs) how often each output of the network has said that a size goes on.
_GOES_ON = np.cumsum(np.eye(_STEPS.max() + 1)[_STEPS], axis=0) - np.eye(_STEPS.max() + 1)[_STEPS]


@dataclass(frozen=True, slots=True)
class Choice:
    """A picture's integers, what is to be coded, and about how many bits that takes."""

    pyramids: list[Pyramid]
    tape: "Tape"

    @property
    def bits(self) -> float:
        """About what it costs."""
        return self.tape.bits


def choose(series: Series, coefficients: Sequence[tuple[Array, list[list[Array]]]]) -> Choice:
    """The integers of a picture's planes as the next of `series`, which goes on to it.

    coefficients: of each plane in steps, as `wavelet.transform` has them.
    """
    tape = Tape()
    return Choice(series.code([_Bands(tape, *plane) for plane in coefficients]), tape)


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


class _BitCounter:
    """A coder that only counts."""

    def __init__(self) -> None:
        self.bits = 0.0

    def code_bit(self, bit: int, zero: int) -> int:
        """Add what `bit` costs; returns it."""
        self.bits += float(_ZERO_BITS[WHOLE - zero if bit else zero])
        return bit


@dataclass(frozen=True, slots=True)
class _Bands:
    """The bands of one plane: coefficients in steps."""

    tape: Tape
    rough: Array
    details: list[list[Array]]

    @property
    def pyramid(self) -> Pyramid:
        right, down, _ = self.details[-1]
        return blank((len(right) + len(down), right.shape[1] + down.shape[1]))

    def coarse(self, integers: AdaptiveIntegers, context: int) -> Integers:
        values, counter = np.rint(self.rough).astype(np.int64), _BitCounter()
        code_coarse(counter, deepcopy(integers), context, values)
        self.tape.add(lambda coder: code_coarse(coder, integers, context, values), counter.bits)
        return values

    def band(self, site: Site) -> "_Band":
        values = self.details[site.level - 1][site.orientation] if site.level else self.rough
        return _Band(self.tape, values)


@dataclass(frozen=True, slots=True)
class _Band:
    """One band; values: (h, w) coefficients in steps."""

    tape: Tape
    values: Array

    def flags(self, zeros: Integers, turn: Turn) -> Integers:
        worth = by_tile((np.abs(self.values) > WORTH_A_TILE).astype(np.int64))
        return self._certain((worth[turn.rows, turn.columns] > 0).astype(np.int64), zeros)

    def sizes(self, zeros: Integers, turn: Turn) -> Integers:
        wanted = np.abs(self.values[turn.rows, turn.columns])
        sizes, bits = np.zeros(len(wanted), np.int64), _ZERO_BITS.take(zeros[:, 0])
        some = np.flatnonzero(wanted > 0.5)
        sizes[some], bits[some] = _cheapest(wanted[some], zeros[some])
        self.tape.add(partial(code_sizes, sizes=sizes, zeros=zeros), float(bits.sum()))
        return sizes.copy()

    def signs(self, zeros: Integers, turn: Turn) -> Integers:
        return self._certain((self.values[turn.rows, turn.columns] < 0).astype(np.int64), zeros)

    def _certain(self, bits: Integers, zeros: Integers) -> Integers:
        """Bits that leave no choice."""
        cost = float(_ZERO_BITS.take(np.where(bits, WHOLE - zeros, zeros)).sum())
        self.tape.add(partial(code_bits_each, bits=bits, zeros=zeros), cost)
        return bits


def _cheapest(wanted: Array, zeros: Integers) -> tuple[Integers, Array]:
    """(n,) sizes for coefficients of `wanted` > 0.5 steps, and their bits without signs."""
    nearest = np.floor(wanted + 0.5).astype(np.int64)
    stop, on = _ZERO_BITS.take(zeros), _ZERO_BITS.take(WHOLE - zeros)
    sizes = np.array([nearest, nearest - 1, np.zeros_like(nearest)])
    unary = np.minimum(sizes, UNARY - 1)
    every = np.arange(len(wanted))
    steps = np.einsum("no,cno->cn", on, _GOES_ON.take(unary, 0))
    length = np.floor(np.log2(np.maximum(sizes - UNARY, 0) + 1))
    beyond = (2 * length + 1) * (sizes >= UNARY)
    last = _STEPS.take(unary)
    bits = steps + np.where(sizes < UNARY, stop[every, last], on[every, last]) + beyond
    error = (wanted - sizes + TOWARDS_ZERO * (sizes > 0)) ** 2
    best = (error + LAGRANGIAN * (bits + SIGN_BITS * (sizes > 0))).argmin(0)
    return sizes[best, every], bits[best, every]
