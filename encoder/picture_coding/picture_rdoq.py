"""Rate-distortion optimised quantisation (RDOQ) of a picture's wavelet coefficients.

Subbands are quantised by `quantise_subband`.  The coefficients of the lowpass band of backgrounds
and textures are rounded to the nearest integer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from encoder.picture_coding.subband_rdoq import ZERO_BITS, QuantisedBand, quantise_subband
from encoder.picture_coding.symbol_writing import (
    DecisionRecorder,
    Decisions,
    band_decisions,
    range_coded,
)
from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.pictures.coefficient_coding import code_lowpass_band
from protocol.pictures.probability_model import BandPosition
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid, plane_shape
from shared_model.arrays import Array, Integers


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
        self._parts: list[Decisions | QuantisedBand] = []
        self.bits = 0.0

    def append(self, part: Decisions | QuantisedBand, bits: float) -> None:
        """Add symbols.  bits: their ideal code length."""
        self._parts.append(part)
        self.bits += bits

    def serialise(self) -> bytes:
        """The bytes of all symbols."""
        return range_coded(
            [band_decisions(p) if isinstance(p, QuantisedBand) else p for p in self._parts]
        )


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
        recorder = DecisionRecorder()
        values = code_lowpass_band(
            recorder, integers, context, np.rint(self.lowpass).astype(np.int64)
        )
        bits, p0 = recorder.recorded()
        cost = float(ZERO_BITS.take(np.where(bits, PROBABILITY_ONE - p0, p0)).sum())
        self.symbols.append((bits, p0), cost)
        return values

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        quantised = quantise_subband(
            position, position.select(self.lowpass, self.details), context_bands
        )
        self.symbols.append(quantised, quantised.bits)
        return quantised.values
