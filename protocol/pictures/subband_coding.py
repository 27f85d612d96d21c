"""Coding of the wavelet coefficients of picture planes: their order and their contexts.

A plane's lowpass band comes first, then the details level by level.  In each band the tile flags
precede the coefficients, see `coefficient_context`.  The lowpass band of a mode is coded as the
other bands are; that of a background or a texture is predicted from its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
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
    CodingPass,
    CoefficientContext,
    ContextBand,
    box_sum,
    crop_or_pad,
    tile_sums,
    upsample,
)
from protocol.pictures.probability_model import LOWPASS, MODE, BandPosition, probability_models
from protocol.pictures.subband_pyramid import (
    Shape,
    SubbandPyramid,
    empty_pyramid,
    map_bands,
    plane_shape,
)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class PlaneCoder(Protocol):
    """Codes the bands of a plane in order: an encoder chooses the values, a decoder reads them."""

    @property
    def shape(self) -> Shape:
        """Height and width of the plane."""
        ...

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        """The lowpass band of a background or texture, in the shape of `empty`.

        See `code_lowpass_band`.
        """
        ...

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        """Any other band (h, w).  context_bands: (len(ContextBand), h, w)."""
        ...


@dataclass(slots=True)
class PictureSequence:
    """Pictures of one kind and size, each coded in the context of those before.

    kind: see `BandPosition`.
    pictures: number of pictures so far.
    """

    kind: int
    pictures: int = 0
    _last: list[SubbandPyramid] = field(default_factory=list)
    _totals: list[SubbandPyramid] = field(default_factory=list)

    def copy(self) -> "PictureSequence":
        """An independent copy."""
        return replace(self)

    def check_shapes(self, shapes: Sequence[Shape]) -> None:
        """Raise `ValueError` unless planes of `shapes` can be the next picture."""
        expected = [plane_shape(pyramid.details) for pyramid in self._last]
        if self.pictures and expected != list(shapes):
            raise ValueError("pictures of one sequence differ in size")

    def code(self, planes: Sequence[PlaneCoder]) -> list[SubbandPyramid]:
        """Code the next picture: luma, then the colour differences, half its size.

        The sequence does not change, see `advance`.  Raises `ValueError` as `check_shapes` and the
        coders do.
        """
        self.check_shapes([plane.shape for plane in planes])
        integers = AdaptiveIntegers(2)
        coded: list[SubbandPyramid] = []
        for index, plane in enumerate(planes):
            coded.append(self._plane(index, plane, coded, integers))
        return coded

    def advance(self, coded: list[SubbandPyramid]) -> None:
        """Add the picture that was coded to the context of the next."""
        totals = [map_bands(np.abs, pyramid) for pyramid in coded]
        if self.pictures:
            totals = [map_bands(np.add, *pair) for pair in zip(self._totals, totals, strict=True)]
        self._last, self._totals = coded, totals
        self.pictures += 1

    def _plane(
        self,
        plane: int,
        coder: PlaneCoder,
        previous_planes: Sequence[SubbandPyramid],
        integers: AdaptiveIntegers,
    ) -> SubbandPyramid:
        empty = empty_pyramid(coder.shape)
        position = BandPosition(self.kind, plane, 0, LOWPASS, self.pictures)
        if self.kind == MODE:
            bands = self._context_bands(position, empty.lowpass.shape, [], [], previous_planes)
            lowpass = coder.band(position, bands)
        else:
            lowpass = coder.lowpass_band(empty.lowpass, integers, int(plane > 0))
        details: list[list[Integers]] = []
        parents: list[Integers] = []
        for level, blanks in enumerate(empty.details, 1):
            done: list[Integers] = []
            for orientation, band in enumerate(blanks):
                position = BandPosition(self.kind, plane, level, orientation, self.pictures)
                bands = self._context_bands(position, band.shape, parents, done, previous_planes)
                done.append(coder.band(position, bands) if band.size else band)
            details.append(done)
            parents = [np.abs(band) for band in done]
        return SubbandPyramid(lowpass, details)

    def _context_bands(
        self,
        position: BandPosition,
        shape: Shape,
        parents: list[Integers],
        done: list[Integers],
        previous_planes: Sequence[SubbandPyramid],
    ) -> Integers:
        """(len(ContextBand), h, w) the bands that predict a band.

        parents: magnitudes of the bands of the coarser level.  done: bands of this level so far.
        """
        bands = np.zeros((len(ContextBand), *shape), np.int64)
        if parents:
            own = parents[position.orientation]
            others = sum(
                crop_or_pad(parent, own.shape)
                for orientation, parent in enumerate(parents)
                if orientation != position.orientation
            )
            bands[ContextBand.PARENT] = upsample(own, 2, shape)
            bands[ContextBand.PARENT_RING] = upsample(box_sum(own) - own, 2, shape)
            bands[ContextBand.OTHER_PARENTS] = upsample(np.asarray(others), 2, shape)
        for index, band in enumerate(reversed(done)):
            bands[ContextBand.PREVIOUS_BAND + index] = crop_or_pad(np.abs(band), shape)
        if self.pictures:
            bands[ContextBand.PREVIOUS_PICTURES] = self._totals[position.plane].band(position)
            bands[ContextBand.PREVIOUS_PICTURE] = self._last[position.plane].band(position)
        if position.plane and position.level > 1:
            # The colour planes have half the size of luma.
            of_luma = replace(position, level=position.level - 1)
            bands[ContextBand.LUMA] = crop_or_pad(previous_planes[0].band(of_luma), shape)
        if position.plane > 1:
            bands[ContextBand.FIRST_CHROMA] = previous_planes[1].band(position)
        return bands

    def predict_tiles(
        self, context: CoefficientContext, position: BandPosition, coding_pass: CodingPass
    ) -> Integers:
        """(n,) probabilities that the tiles of a pass have no flag, in 1/65536."""
        features, mlp = context.magnitude_features(coding_pass), probability_models().tiles
        return mlp.zero_probabilities(features, position, coding_pass)[:, 0]

    def predict_magnitudes(
        self, context: CoefficientContext, position: BandPosition, coding_pass: CodingPass
    ) -> Integers:
        """(n, outputs) probabilities of the unary decisions, see `ProbabilityModels`."""
        features, mlp = context.magnitude_features(coding_pass), probability_models().sizes
        return mlp.zero_probabilities(features, position, coding_pass)

    def predict_signs(
        self, context: CoefficientContext, position: BandPosition, coding_pass: CodingPass
    ) -> Integers:
        """(n,) probabilities that the coefficients of a pass are positive, in 1/65536."""
        features, mlp = context.sign_features(coding_pass), probability_models().signs
        return mlp.zero_probabilities(features, position, coding_pass)[:, 0]


@dataclass(frozen=True, slots=True)
class _PlaneDecoder:
    """A `PlaneCoder` that reads a plane of the next picture of `sequence`."""

    sequence: PictureSequence
    coder: RangeDecoder
    shape: Shape

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        return code_lowpass_band(self.coder, integers, context, empty)

    def band(self, position: BandPosition, context_bands: Integers) -> Integers:
        shape = context_bands.shape[1:]
        flags = self._tile_flags(position, tile_sums(np.abs(context_bands)))
        active, around = (upsample(each, TILE, shape) for each in (flags, box_sum(flags)))
        band = np.zeros(shape, np.int64)
        context = CoefficientContext(context_bands, active > 0, around)
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

    def _tile_flags(self, position: BandPosition, context_bands: Integers) -> Integers:
        """(rows, columns) 1 for each tile that may have nonzero coefficients.

        context_bands: (len(ContextBand), rows, columns) sums over tiles.
        """
        grid = context_bands.shape[1:]
        if grid[0] * grid[1] * TILE**2 <= SMALL_BAND:
            return np.ones(grid, np.int64)
        flags = np.zeros(grid, np.int64)
        context = CoefficientContext(context_bands, np.ones(grid, bool), np.zeros(grid, np.int64))
        for coding_pass in context.passes():
            bits = self._bits(self.sequence.predict_tiles(context, position, coding_pass))
            context.set_known(coding_pass, bits)
            flags[coding_pass.rows, coding_pass.columns] = bits
        return flags

    def _bits(self, zeros: Integers) -> Integers:
        return code_bit_array(self.coder, np.zeros_like(zeros), zeros)


def decode_planes(
    sequence: PictureSequence, name: str, data: bytes, shapes: Sequence[Shape]
) -> list[SubbandPyramid]:
    """Decode planes of `shapes`, the next picture of `sequence`, and advance the sequence.

    name: of the picture, for the message.
    Raises `ProtocolError` if `data` is damaged; then the sequence does not advance.
    """
    sequence.check_shapes(shapes)
    coder = RangeDecoder(data)
    try:
        pyramids = sequence.code([_PlaneDecoder(sequence, coder, shape) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: {coder.unread_bytes} bytes too many")
    sequence.advance(pyramids)
    return pyramids
