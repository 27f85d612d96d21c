"""Rate-distortion optimised quantisation (RDOQ) of a picture's wavelet coefficients.

Subbands are quantised by `quantise_subband`.  The coefficients of the lowpass band of backgrounds
and textures are rounded to the nearest integer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from encoder.picture_coding.subband_rdoq import ZERO_BITS, QuantisedBand, quantise_subband
from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import PROBABILITY_ONE, BitCoder, RangeEncoder
from protocol.pictures.coefficient_coding import code_bit_array, code_lowpass_band, code_magnitudes
from protocol.pictures.probability_model import BandPosition
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid, plane_shape

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def quantise_picture(
    series: PictureSequence, coefficients: Sequence[tuple[Array, list[list[Array]]]]
) -> tuple[list[SubbandPyramid], "SymbolBuffer"]:
    """Quantise a picture's planes as the next picture of `series`, and advance `series` by it.

    coefficients: of each plane, in quantiser steps, see `wavelet.transform`.
    Returns the integers of each plane, and the symbols that code them.
    """
    symbols = SymbolBuffer()
    pyramids = series.code([_RdoPlaneCoder(symbols, *plane) for plane in coefficients])
    series.advance(pyramids)
    return pyramids, symbols


class SymbolBuffer:
    """Symbols in coding order, before entropy coding.

    bits: their ideal code length.
    """

    def __init__(self) -> None:
        self._write_calls: list[Callable[[BitCoder], object]] = []
        self.bits = 0.0

    def append(self, write: Callable[[BitCoder], object], bits: float) -> None:
        """Add symbols.

        write: codes them with a given coder.  bits: their ideal code length.
        """
        self._write_calls.append(write)
        self.bits += bits

    def serialise(self) -> bytes:
        """The bytes of all symbols."""
        coder = RangeEncoder()
        for write in self._write_calls:
            write(coder)
        return coder.finish()


class _BitRecorder:
    """A `BitCoder` that records bits and their probabilities."""

    def __init__(self) -> None:
        self._recorded: list[tuple[int, int]] = []

    def code_bit(self, bit: int, zero: int) -> int:
        """Record `bit` and the probability `zero` of a zero; returns `bit`."""
        self._recorded.append((bit, zero))
        return bit

    def recorded(self) -> tuple[Integers, Integers]:
        """(n,) bits, and (n,) probabilities of a zero."""
        bits, p0 = np.array(self._recorded, np.int64).reshape(-1, 2).T
        return bits, p0


@dataclass(frozen=True, slots=True)
class _RdoPlaneCoder:
    """A `PlaneCoder` that quantises.

    lowpass, details: the plane's coefficients, in quantiser steps, see `wavelet.transform`.
    """

    symbols: SymbolBuffer
    lowpass: Array
    details: list[list[Array]]

    @property
    def shape(self) -> tuple[int, int]:
        return plane_shape(self.details)

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        recorder = _BitRecorder()
        values = code_lowpass_band(
            recorder, integers, context, np.rint(self.lowpass).astype(np.int64)
        )
        bits, p0 = recorder.recorded()
        cost = float(ZERO_BITS.take(np.where(bits, PROBABILITY_ONE - p0, p0)).sum())
        self.symbols.append(partial(code_bit_array, bits=bits, zeros=p0), cost)
        return values

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        quantised = quantise_subband(
            position, position.select(self.lowpass, self.details), context_bands
        )
        self.symbols.append(partial(_write_band, quantised), quantised.bits)
        return quantised.values


def _write_band(band: QuantisedBand, coder: BitCoder) -> None:
    """Code a band in the order in which `protocol.pictures.subband_coding` reads it."""
    code_bit_array(coder, band.flags, band.flag_p0)
    magnitude = sign = 0
    for magnitude_end, sign_end in band.pass_ends.tolist():
        of_pass = slice(magnitude, magnitude_end)
        code_magnitudes(coder, band.magnitudes[of_pass], band.magnitude_p0[of_pass])
        code_bit_array(coder, band.signs[sign:sign_end], band.sign_p0[sign:sign_end])
        magnitude, sign = magnitude_end, sign_end
