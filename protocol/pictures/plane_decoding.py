"""Decoding of the planes of a picture.

The loops over the symbols of a subband are compiled where Numba is installed (`band_decoding`);
without it, or where the networks' inputs are wanted, `ArrayBandDecoder` reads the same with NumPy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder
from protocol.errors import ProtocolError
from protocol.pictures.coefficient_coding import code_bit_array, code_lowpass_band, code_magnitudes
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
from protocol.pictures.subband_pyramid import Shape, SubbandPyramid

Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]


class BandDecoder(Protocol):
    """Reads the symbols of a subband."""

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        """The coefficients (h, w), after the flags of the band's tiles, if it has any.

        context_bands: (len(ContextBand), h, w).
        Raises `ValueError` if a magnitude is too large.
        """
        ...


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
        self, position: BandPosition, context_bands: Integers, active: Bools, tile_flags: Integers
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


@dataclass(frozen=True, slots=True)
class _PlaneDecoder:
    """A `PlaneCoder` that reads a plane."""

    coder: RangeDecoder
    bands: BandDecoder
    shape: Shape

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        return code_lowpass_band(self.coder, integers, context, empty)

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        return self.bands.band(position, context_bands)


def band_decoder(sequence: PictureSequence, coder: RangeDecoder) -> BandDecoder:
    """The fastest decoder of the bands of `sequence` that runs here."""
    if find_spec("numba") is None:
        return ArrayBandDecoder(sequence, coder)
    # Imported where used: Numba takes more than a second.
    from protocol.pictures.band_decoding import CompiledBandDecoder

    return CompiledBandDecoder(coder)


def decode_planes(
    sequence: PictureSequence,
    name: str,
    data: bytes,
    shapes: Sequence[Shape],
    make_decoder: Callable[[PictureSequence, RangeDecoder], BandDecoder] = band_decoder,
) -> list[SubbandPyramid]:
    """Decode planes of `shapes`, the next picture of `sequence`, and advance the sequence.

    name: of the picture, for the message.
    Raises `ProtocolError` if `data` is damaged; then the sequence does not advance.
    """
    sequence.check_shapes(shapes)
    coder = RangeDecoder(data)
    bands = make_decoder(sequence, coder)
    try:
        pyramids = sequence.code([_PlaneDecoder(coder, bands, shape) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: {coder.unread_bytes} bytes too many")
    sequence.advance(pyramids)
    return pyramids
