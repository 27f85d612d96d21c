"""Decoding of one subband with NumPy, which shows what each network was asked.

It reads the same symbols as `protocol/pictures/band_decoding.py`, and holds it in the tests.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from assets.array_context import (
    CodingPass,
    CoefficientContext,
    network_probabilities,
    tile_sums,
)
from protocol.entropy.integer_codes import code_exp_golomb
from protocol.entropy.range_coder import BitCoder, RangeDecoder
from protocol.pictures.coefficient_coding import LONGEST, STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.coefficient_context import (
    SMALL_BAND,
    TILE,
    box_sum,
    tile_grid,
    upsample,
)
from protocol.pictures.probability_model import BandPosition
from shared_model.arrays import Array, Integers, Mask

# Of a network by its name in `ProbabilityModels`: what it was asked, of which positions, and the
# features of these.
OnAsk = Callable[[str, BandPosition, CodingPass, Array], None]


def _ignore(network: str, position: BandPosition, coding_pass: CodingPass, found: Array) -> None:
    """Nobody wants to know."""


@dataclass(frozen=True, slots=True)
class ArrayBandDecoder:
    """A `BandDecoder`.  on_ask: called before a network is asked."""

    coder: RangeDecoder
    on_ask: OnAsk = _ignore

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
            features = context.magnitude_features(coding_pass)
            bits = self._bits(self._zeros("tiles", features, position, coding_pass)[:, 0])
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
            features = context.magnitude_features(coding_pass)
            zeros = self._zeros("sizes", features, position, coding_pass)
            values = code_magnitudes(self.coder, np.zeros(len(zeros), np.int64), zeros)
            nonzero = values > 0
            if nonzero.any():
                signed = coding_pass.subset(nonzero)
                zeros = self._zeros("signs", context.sign_features(signed), position, signed)
                values[nonzero] *= 1 - 2 * self._bits(zeros[:, 0])
            context.set_known(coding_pass, values)
            band[coding_pass.rows, coding_pass.columns] = values
        return band

    def _zeros(
        self, network: str, features: Array, position: BandPosition, coding_pass: CodingPass
    ) -> Integers:
        self.on_ask(network, position, coding_pass, features)
        return network_probabilities(network, features, position, coding_pass)

    def _bits(self, zeros: Integers) -> Integers:
        return code_bit_array(self.coder, np.zeros_like(zeros), zeros)


def code_bit_array(coder: BitCoder, bits: Integers, zeros: Integers) -> Integers:
    """Code bits (n,), each 0 with probability zeros (n,) / 65536.  Returns the bits coded."""
    pairs = zip(bits.tolist(), zeros.tolist(), strict=True)
    return np.array([coder.code_bit(bit, zero) for bit, zero in pairs], np.int64)


def code_magnitudes(coder: BitCoder, magnitudes: Integers, zeros: Integers) -> Integers:
    """Code magnitudes (n,) of coefficients.

    zeros: (n, outputs) probabilities of `ProbabilityModels.sizes`, in 1/65536.
    Returns the magnitudes coded.  Raises `ValueError` if one exceeds `MAX_MAGNITUDE`.
    """
    pairs = zip(magnitudes.tolist(), zeros.tolist(), strict=True)
    return np.array(
        [_code_magnitude(coder, magnitude, zero) for magnitude, zero in pairs], np.int64
    )


def _code_magnitude(coder: BitCoder, magnitude: int, zeros: list[int]) -> int:
    for reached in range(UNARY_LIMIT):
        if not coder.code_bit(int(magnitude > reached), zeros[STEP_OUTPUTS[reached]]):
            return reached
    return UNARY_LIMIT + code_exp_golomb(coder, magnitude - UNARY_LIMIT, LONGEST)
