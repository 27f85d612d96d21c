"""Which integers a picture's wavelet coefficients become: rate-distortion optimised.

Band by band as `choose_band` says.  Of a still's coarsest subband a coefficient takes the nearest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from encoder.picture_coding.subband_rdoq import ZERO_BITS, Decisions, choose_band
from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import WHOLE, RangeEncoder
from protocol.frames.value_coding import BitCoder
from protocol.pictures.coefficient_coding import code_bits_each, code_coarse, code_sizes
from protocol.pictures.probability_model import Site
from protocol.pictures.subband_coding import Pyramid, Series, plane_shape

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


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

    @property
    def shape(self) -> tuple[int, int]:
        return plane_shape(self.details)

    def coarse(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        pairs = _Pairs()
        values = code_coarse(pairs, integers, context, np.rint(self.rough).astype(np.int64))
        bits, zeros = pairs.both
        cost = float(ZERO_BITS.take(np.where(bits, WHOLE - zeros, zeros)).sum())
        self.tape.add(partial(code_bits_each, bits=bits, zeros=zeros), cost)
        return values

    def band(self, site: Site, sources: Integers) -> Integers:
        made = choose_band(site, site.of(self.rough, self.details), sources)
        self.tape.add(partial(_code_band, made), made.bits)
        return made.values


def _code_band(made: Decisions, coder: BitCoder) -> None:
    """What was decided on a band, as `protocol.pictures.subband_coding` reads it."""
    code_bits_each(coder, made.flags, made.flag_zeros)
    size = sign = 0
    for last_size, last_sign in made.ends.tolist():
        code_sizes(coder, made.sizes[size:last_size], made.size_zeros[size:last_size])
        code_bits_each(coder, made.signs[sign:last_sign], made.sign_zeros[sign:last_sign])
        size, sign = last_size, last_sign
