"""Planes of wavelet coefficients as bytes: which order, and by what probabilities.

A plane's coarsest subband comes first, then the details level by level.  In each band flags say
which tiles hold anything, then come the coefficients of those; see `coefficient_context`.  Of a
mode the coarsest subband is coded as the others are, of stills it is predicted from its neighbours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

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
from protocol.pictures.wavelet import LEVELS, inverse_transform

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = tuple[int, int]

# Coefficients of a size lie a little nearer to zero than its middle.
RECONSTRUCTION_BIAS = 0.05


@dataclass(frozen=True, slots=True)
class SubbandPyramid:
    """A plane's integers: the coarsest subband, and three details a level, the coarsest first."""

    lowpass: Integers
    details: list[list[Integers]]

    def band(self, site: BandPosition) -> Integers:
        """The band of this level and orientation."""
        return site.select(self.lowpass, self.details)


class PlaneCoder(Protocol):
    """Codes one plane, in order: an encoder decides what comes, a decoder reads it."""

    @property
    def shape(self) -> Shape:
        """Of the plane."""
        ...

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        """The coarsest subband of a still, in the shape of `empty`; see `code_coarse`."""
        ...

    def band(self, site: BandPosition, sources: Integers) -> Integers:
        """Any other band, in the shape of sources (len(Source), h, w): what goes with it."""
        ...


@dataclass(slots=True)
class PictureSequence:
    """Pictures of one kind and size, coded one after the other; each foretells the next.

    kind: see `foresee.Site`.
    """

    kind: int
    pictures: int = 0
    _last: list[SubbandPyramid] = field(default_factory=list)
    _totals: list[SubbandPyramid] = field(default_factory=list)

    def copy(self) -> "PictureSequence":
        """What can go on by itself."""
        return replace(self)

    def check_shapes(self, shapes: Sequence[Shape]) -> None:
        """Raise `ValueError` if planes of `shapes` are no further picture of this series."""
        known = [plane_shape(pyramid.details) for pyramid in self._last]
        if self.pictures and known != list(shapes):
            raise ValueError("pictures of one series differ in size")

    def code(self, planes: Sequence[PlaneCoder]) -> list[SubbandPyramid]:
        """Code a picture: luma, then colours at half its size.

        The series is as it was, see `learn`.  Raises `ValueError` as `expect` and the coders do.
        """
        self.check_shapes([plane.shape for plane in planes])
        integers = AdaptiveIntegers(2)
        coded: list[SubbandPyramid] = []
        for index, plane in enumerate(planes):
            coded.append(self._plane(index, plane, coded, integers))
        return coded

    def advance(self, coded: list[SubbandPyramid]) -> None:
        """Go on to the picture that was coded."""
        sizes = [_map(np.abs, pyramid) for pyramid in coded]
        if self.pictures:
            sizes = [_map(np.add, *pair) for pair in zip(self._totals, sizes, strict=True)]
        self._last, self._totals = coded, sizes
        self.pictures += 1

    def _plane(
        self,
        plane: int,
        coder: PlaneCoder,
        before: Sequence[SubbandPyramid],
        integers: AdaptiveIntegers,
    ) -> SubbandPyramid:
        empty = empty_pyramid(coder.shape)
        site = BandPosition(self.kind, plane, 0, LOWPASS, self.pictures)
        if self.kind == MODE:
            sources = self._context_bands(site, empty.lowpass.shape, [], [], before)
            coarse = coder.band(site, sources)
        else:
            coarse = coder.lowpass_band(empty.lowpass, integers, int(plane > 0))
        details: list[list[Integers]] = []
        parents: list[Integers] = []
        for level, blanks in enumerate(empty.details, 1):
            done: list[Integers] = []
            for orientation, band in enumerate(blanks):
                site = BandPosition(self.kind, plane, level, orientation, self.pictures)
                sources = self._context_bands(site, band.shape, parents, done, before)
                done.append(coder.band(site, sources) if band.size else band)
            details.append(done)
            parents = [np.abs(band) for band in done]
        return SubbandPyramid(coarse, details)

    def _context_bands(
        self,
        site: BandPosition,
        shape: Shape,
        parents: list[Integers],
        done: list[Integers],
        before: Sequence[SubbandPyramid],
    ) -> Integers:
        """(len(Source), h, w) what goes with a band."""
        sources = np.zeros((len(ContextBand), *shape), np.int64)
        if parents:
            own = parents[site.orientation]
            others = sum(
                crop_or_pad(p, own.shape) for i, p in enumerate(parents) if i != site.orientation
            )
            sources[ContextBand.PARENT] = upsample(own, 2, shape)
            sources[ContextBand.PARENT_RING] = upsample(box_sum(own) - own, 2, shape)
            sources[ContextBand.OTHER_PARENTS] = upsample(np.asarray(others), 2, shape)
        for index, band in enumerate(reversed(done)):
            sources[ContextBand.PREVIOUS_BAND + index] = crop_or_pad(np.abs(band), shape)
        if self.pictures:
            sources[ContextBand.PREVIOUS_PICTURES] = self._totals[site.plane].band(site)
            sources[ContextBand.PREVIOUS_PICTURE] = self._last[site.plane].band(site)
        if site.plane and site.level > 1:
            finer = replace(site, level=site.level - 1)
            sources[ContextBand.LUMA] = crop_or_pad(before[0].band(finer), shape)
        if site.plane > 1:
            sources[ContextBand.FIRST_CHROMA] = before[1].band(site)
        return sources

    def predict_tiles(
        self, around: CoefficientContext, site: BandPosition, turn: CodingPass
    ) -> Integers:
        """(n,) probabilities that tiles hold nothing."""
        return probability_models().tiles.zero_probabilities(
            around.magnitude_features(turn), site, turn
        )[:, 0]

    def predict_magnitudes(
        self, around: CoefficientContext, site: BandPosition, turn: CodingPass
    ) -> Integers:
        """(n, outputs) probabilities of sizes, see `foresee.Networks`."""
        return probability_models().sizes.zero_probabilities(
            around.magnitude_features(turn), site, turn
        )

    def predict_signs(
        self, around: CoefficientContext, site: BandPosition, turn: CodingPass
    ) -> Integers:
        """(n,) probabilities that coefficients are positive."""
        return probability_models().signs.zero_probabilities(
            around.sign_features(turn), site, turn
        )[:, 0]


def empty_pyramid(shape: Shape) -> SubbandPyramid:
    """Zeros in the shapes that `wavelet.transform` makes of a plane."""
    levels: list[list[Integers]] = []
    height, width = shape
    for _ in range(LEVELS):
        low, high = (-(-height // 2), -(-width // 2)), (height // 2, width // 2)
        shapes = ((low[0], high[1]), (high[0], low[1]), high)
        levels.append([np.zeros(each, np.int64) for each in shapes])
        height, width = low
    return SubbandPyramid(np.zeros((height, width), np.int64), levels[::-1])


def plane_shape(details: Sequence[Sequence[NDArray[Any]]]) -> Shape:
    """Of the plane that has these details."""
    right, down, _ = details[-1]
    return len(right) + len(down), right.shape[1] + down.shape[1]


def _map(function: Callable[..., Integers], *pyramids: SubbandPyramid) -> SubbandPyramid:
    """A function of the bands of pyramids, band by band."""
    coarse = function(*(pyramid.lowpass for pyramid in pyramids))
    levels = zip(*(pyramid.details for pyramid in pyramids), strict=True)
    details = [[function(*bands) for bands in zip(*level, strict=True)] for level in levels]
    return SubbandPyramid(coarse, details)


@dataclass(frozen=True, slots=True)
class _PlaneDecoder:
    """Reads a plane of `shape` of the next picture of `series`."""

    series: PictureSequence
    coder: RangeDecoder
    shape: Shape

    def lowpass_band(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        return code_lowpass_band(self.coder, integers, context, empty)

    def band(self, site: BandPosition, sources: Integers) -> Integers:
        shape = sources.shape[1:]
        flags = self._flags(site, tile_sums(np.abs(sources)))
        active, busy = (upsample(each, TILE, shape) for each in (flags, box_sum(flags)))
        result = np.zeros(shape, np.int64)
        around = CoefficientContext(sources, active > 0, busy)
        for turn in around.passes():
            zeros = self.series.predict_magnitudes(around, site, turn)
            values = code_magnitudes(self.coder, np.zeros(len(zeros), np.int64), zeros)
            some = values > 0
            if some.any():
                signed = turn.subset(some)
                zeros = self.series.predict_signs(around, site, signed)
                values[some] *= 1 - 2 * self._bits(zeros)
            around.set_known(turn, values)
            result[turn.rows, turn.columns] = values
        return result

    def _flags(self, site: BandPosition, sources: Integers) -> Integers:
        """Which tiles of a band hold anything."""
        grid = sources.shape[1:]
        if grid[0] * grid[1] * TILE**2 <= SMALL_BAND:
            return np.ones(grid, np.int64)
        flags = np.zeros(grid, np.int64)
        around = CoefficientContext(sources, np.ones(grid, bool), np.zeros(grid, np.int64))
        for turn in around.passes():
            found = self._bits(self.series.predict_tiles(around, site, turn))
            around.set_known(turn, found)
            flags[turn.rows, turn.columns] = found
        return flags

    def _bits(self, zeros: Integers) -> Integers:
        return code_bit_array(self.coder, np.zeros_like(zeros), zeros)


def decode_planes(
    series: PictureSequence, name: str, data: bytes, shapes: Sequence[Shape]
) -> list[SubbandPyramid]:
    """The planes of `shapes` that `data` holds, the next picture of `series`.

    name: what it is, for the message.  Raises `ProtocolError` if `data` holds none; then the series
    is as it was.
    """
    series.check_shapes(shapes)
    coder = RangeDecoder(data)
    try:
        pyramids = series.code([_PlaneDecoder(series, coder, shape) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"{name}: {coder.unread_bytes} bytes too many")
    series.advance(pyramids)
    return pyramids


def dequantised(pyramid: SubbandPyramid, step: float) -> Array:
    """The plane that integers stand for, in steps of `step`."""
    details = [
        [step * (band - RECONSTRUCTION_BIAS * np.sign(band)) for band in level]
        for level in pyramid.details
    ]
    return inverse_transform((pyramid.lowpass * step).astype(np.float64), details)
