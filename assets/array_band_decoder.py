"""Decoding of one subband with NumPy, which shows what each network was asked.

It reads the same symbols as `protocol/pictures/band_decoding.py`, and holds it in the tests.
"""

from dataclasses import dataclass

import numpy as np

from protocol.entropy.range_coder import RangeDecoder
from protocol.pictures.coefficient_coding import code_bit_array, code_magnitudes
from protocol.pictures.coefficient_context import (
    SMALL_BAND,
    TILE,
    CoefficientContext,
    box_sum,
    tile_grid,
    tile_sums,
    upsample,
)
from protocol.pictures.probability_model import BandPosition
from protocol.pictures.subband_coding import PictureSequence
from shared_model.arrays import Integers, Mask


@dataclass(frozen=True, slots=True)
class ArrayBandDecoder:
    """A `BandDecoder` that asks `sequence` for the probabilities of each pass."""

    sequence: PictureSequence
    coder: RangeDecoder

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        """See `BandDecoder`."""
        shape = context_bands.shape[1:]
        grid = tile_grid(shape)
        flags = np.ones(grid, np.int64)
        if grid[0] * grid[1] * TILE**2 > SMALL_BAND:
            flags = self._tile_flags(position, tile_sums(np.abs(context_bands)))
        active, around = (upsample(each, TILE, shape) for each in (flags, box_sum(flags)))
        return self._coefficients(position, context_bands, active > 0, around)

    def _tile_flags(self, position: BandPosition, context_bands: Integers) -> Integers:
        """(rows, columns) 1 for each tile that may have nonzero coefficients.

        context_bands: (len(ContextBand), rows, columns) sums over tiles.
        """
        grid = context_bands.shape[1:]
        flags = np.zeros(grid, np.int64)
        context = CoefficientContext(context_bands, np.ones(grid, bool), np.zeros(grid, np.int64))
        for coding_pass in context.passes():
            bits = self._bits(self.sequence.predict_tiles(context, position, coding_pass))
            context.set_known(coding_pass, bits)
            flags[coding_pass.rows, coding_pass.columns] = bits
        return flags

    def _coefficients(
        self, position: BandPosition, context_bands: Integers, active: Mask, tile_flags: Integers
    ) -> Integers:
        """The coefficients (h, w); those that are not `active` (h, w) are zero.

        tile_flags: (h, w) number of flagged tiles among the nine around a position.
        """
        band = np.zeros(active.shape, np.int64)
        context = CoefficientContext(context_bands, active, tile_flags)
        for coding_pass in context.passes():
            zeros = self.sequence.predict_magnitudes(context, position, coding_pass)
            values = code_magnitudes(self.coder, np.zeros(len(zeros), np.int64), zeros)
            nonzero = values > 0
            if nonzero.any():
                signed = coding_pass.subset(nonzero)
                zeros = self.sequence.predict_signs(context, position, signed)
                values[nonzero] *= 1 - 2 * self._bits(zeros)
            context.set_known(coding_pass, values)
            band[coding_pass.rows, coding_pass.columns] = values
        return band

    def _bits(self, zeros: Integers) -> Integers:
        return code_bit_array(self.coder, np.zeros_like(zeros), zeros)
