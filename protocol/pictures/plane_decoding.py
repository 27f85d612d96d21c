"""Decoding of the planes of a picture; the loops over a subband's symbols are compiled."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder
from protocol.errors import ProtocolError
from protocol.pictures.coefficient_coding import code_lowpass_band
from protocol.pictures.probability_model import BandPosition
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import Shape, SubbandPyramid
from shared_model.arrays import Integers


class BandDecoder(Protocol):
    """Reads the symbols of a subband."""

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        """The coefficients (h, w), after the flags of the band's tiles, if it has any.

        context_bands: (len(ContextBand), h, w).
        Raises `ValueError` if a magnitude is too large.
        """
        ...


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


def compiled_bands(coder: RangeDecoder) -> BandDecoder:
    """The decoder of a picture's bands whose loops are compiled."""
    # Imported where used: Numba takes more than a second.
    from protocol.pictures.band_decoding import CompiledBandDecoder

    return CompiledBandDecoder(coder)


def decode_planes(
    sequence: PictureSequence,
    name: str,
    data: bytes,
    shapes: Sequence[Shape],
    make_decoder: Callable[[RangeDecoder], BandDecoder] = compiled_bands,
) -> list[SubbandPyramid]:
    """Decode planes of `shapes`, the next picture of `sequence`, and advance the sequence.

    name: of the picture, for the message.
    Raises `ProtocolError` if `data` is damaged; then the sequence does not advance.
    """
    sequence.check_shapes(shapes)
    coder = RangeDecoder(data)
    bands = make_decoder(coder)
    try:
        pyramids = sequence.code([_PlaneDecoder(coder, bands, shape) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: {coder.unread_bytes} bytes too many")
    sequence.advance(pyramids)
    return pyramids
