"""Coding of the wavelet coefficients of picture planes: their order and their contexts.

A plane's lowpass band comes first, then the details level by level.  In each band the tile flags
precede the coefficients, see `coefficient_context`.  The lowpass band of a mode is coded as the
other bands are; that of a background or a texture is predicted from its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.pictures.coefficient_context import (
    ContextBand,
    box_sum,
    crop_or_pad,
    upsample,
)
from protocol.pictures.probability_model import LOWPASS, MODE, BandPosition
from protocol.pictures.subband_pyramid import (
    Shape,
    SubbandPyramid,
    empty_pyramid,
    map_bands,
    plane_shape,
)
from shared_model.arrays import Integers


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
